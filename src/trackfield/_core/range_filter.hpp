// The belief about one tagged target, conditioned on ranges: prediction, iterated update, learning.
//
// State, in this order: position (D), velocity (D), then those of height, turn rate, scale error,
// common bias that the site leaves open, then per slot (a recently heard sensor) its own bias and
// its correlated error. Every mode of the IMM carries the same state; all matrices are row-major.
#pragma once

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstdint>
#include <limits>
#include <vector>

namespace trackfield {

constexpr double kTwoPi = 6.283185307179586;
constexpr int kMaxModes = 4;
constexpr double kLeastSigma = 1e-3;  // of a range [m]: less would drown in rounding
constexpr double kLongest = 1e7;      // a number beyond this is no range at all [m]

struct SensorModel {
    double x = 0, y = 0, z = 0;
    double bias = 0, scale = 0;          // means of n and gamma, Wang (2)
    double variance = 0.0225;            // of n [m^2]
    double scale_variance = 0;           // of gamma
    double max_range = 1e300;
    double correlated_sigma = 0, correlation_length = 1;
    double bias_sigma = 0;
    bool learn = true;
    double placement_variance = 0;  // of what ranges cannot see: antenna against tracked point [m^2]
    double longest = 1e300;         // a reading beyond this is no range of this sensor [m]
};

struct Mode {
    double accel_density = 0;  // white acceleration [m^2/s^3]
    bool turns = false;
    double switch_rate = 0;    // of leaving the mode [1/s]
};

// What is settled before the first reading; Python gives every number (filtering/range_tracker.py).
struct Settings {
    int dimensions = 2;
    bool height_open = false;
    double height = 0, height_sigma = 0, height_time = 0;
    double scale_sigma = 0, common_bias_sigma = 0;
    int modes = 0;
    Mode mode[kMaxModes];
    double velocity_time = 0;         // velocity forgets itself [s]
    double outage_velocity_time = 0;  // the same in what a step lasts beyond turn_max_step [s]
    double velocity_sigma = 0;        // of a start, per axis [m/s]
    double turn_sigma = 0, turn_time = 0, turn_max_step = 0, turn_step = 0;
    bool robust = true;
    double p_nlos = 0, nlos_sigmas = 0, p_outlier = 0, outlier_sigmas = 0;
    double shares_weight = 0, memory_shares = 0;  // prior and memory of the shares, in readings
    int iterations = 0;
    double noise_floor = 0;                       // [m]
    double memory_own = 0, memory_pool = 0;       // of learned noise, in readings
    double pool_weight = 0, prior_weight = 0;     // of the pool for a sensor, of the model for the pool
    double worst_factor = 0;                      // of learned variance over the model's
    int slots = 0;
    bool slot_bias = false, slot_correlated = false;
    double slot_idle = 0;  // a slot silent for this long may be given to another sensor [s]
    double drop_time = 0;
    double lag_time = 0;
    int lag_steps = 0;
    double every = 0;
    double window = 0;
    int start_readings = 0, start_sensors = 0;
    double start_span = 0;  // readings older than this do not start a track [s]
    int restart_window = 0;
};

struct Layout {
    int D = 2, height = -1, turn = -1, scale = -1, bias = -1, slot0 = 0, per_slot = 0, n = 4;
    int slot_bias = -1, slot_correlated = -1;  // offsets inside a slot

    explicit Layout(const Settings &s) : D(s.dimensions) {
        n = 2 * D;
        if (s.height_open) height = n++;
        for (int j = 0; j < s.modes; ++j)
            if (s.mode[j].turns && turn < 0) turn = n++;
        if (s.scale_sigma > 0) scale = n++;
        if (s.common_bias_sigma > 0) bias = n++;
        slot0 = n;
        if (s.slot_bias) slot_bias = per_slot++;
        if (s.slot_correlated) slot_correlated = per_slot++;
        n += per_slot * s.slots;
    }
};

struct Slot {
    int32_t sensor = -1;
    double last = -1e300;
    double weight = 0, power = 0;  // learned noise: sums over forgotten residuals, in units of the model's variance
};

// A row waiting for its lag: a fixed-point smoother of position and velocity.
struct Pending {
    double t = 0;
    int64_t step = 0;
    int32_t status = 0;
    double nis = 0;
    std::vector<double> mean, cov, gain;  // (2D), (2D, 2D), (2D, n)
};

struct Reading {
    double t = 0, value = 0;
    float sigma = 0;  // NaN or 0: the model's
    int32_t sensor = 0;
};

struct Belief {
    double t = 0;
    bool alive = false;
    int32_t track = -1;
    int64_t step = 0;       // updates so far
    double last_update = 0;
    double mode_probability[kMaxModes] = {};
    std::vector<double> mean[kMaxModes], cov[kMaxModes];
    std::vector<double> m, P;  // moment-matched over modes
    std::vector<Slot> slots;
    double pool_weight = 0, pool_power = 0;
    double heard = 0, heard_nlos = 0, heard_outlier = 0;  // learned shares of the mixture
    uint32_t surprises = 0;  // of the last readings, newest lowest: was the NIS above 9?
    std::vector<Pending> pending;
};

// Room for intermediate results, shared by all targets of a bank.
struct Scratch {
    std::vector<double> mix_mean[kMaxModes], mix_cov[kMaxModes], A, C, G, X, chol, m_pred, P_pred, d;
    std::vector<int> fresh;  // slots given to another sensor in this step
    void size(int n) {
        const size_t nn = size_t(n) * n;
        for (auto &v : mix_mean) v.resize(n);
        for (auto &v : mix_cov) v.resize(nn);
        for (auto *v : {&A, &C, &G, &X, &chol, &P_pred}) v->resize(nn);
        for (auto *v : {&m_pred, &d}) v->resize(n);
    }
};

struct Jacobian {
    int index[8];
    double value[8];
    int count = 0;
    double expected = 0, distance = 0;
    void add(int i, double v) { index[count] = i; value[count++] = v; }

    // H P H', never negative.
    double spread(const double *P, int n) const {
        double sum = 0;
        for (int i = 0; i < count; ++i)
            for (int k = 0; k < count; ++k) sum += value[i] * value[k] * P[index[i] * n + index[k]];
        return std::max(sum, 0.0);
    }
};

class RangeFilter {
  public:
    RangeFilter(const Settings &settings, const std::vector<SensorModel> &sensors)
        : s(settings), sensors_(sensors), L(settings) {
        scratch.size(L.n);
        for (Lane &a : lanes_) {
            for (auto *v : {&a.x, &a.x_lin, &a.PH}) v->resize(L.n);
            a.P.resize(size_t(L.n) * L.n);
        }
        for (const SensorModel &a : sensors_) placement = std::max(placement, a.placement_variance);
    }

    double placement = 0;  // added to the covariance of rows, never to the belief
    const Settings s;
    const std::vector<SensorModel> sensors_;
    const Layout L;
    Scratch scratch;

    // A belief at a place, spread as told, velocity unknown within what targets do.
    void init(Belief &b, double t, const double *position, const double *covariance) const {
        const int n = L.n, D = L.D;
        b.t = t;
        b.last_update = t;
        b.alive = true;
        b.step = 0;
        b.slots.assign(s.slots, Slot{});
        b.pool_weight = b.pool_power = b.heard = b.heard_nlos = b.heard_outlier = 0;
        b.surprises = 0;
        b.pending.clear();
        std::vector<double> m(n, 0.0), P(size_t(n) * n, 0.0);
        for (int i = 0; i < D; ++i) {
            m[i] = position[i];
            for (int k = 0; k < D; ++k) P[i * n + k] = covariance[i * D + k];
            P[(D + i) * n + D + i] = sq(s.velocity_sigma);
        }
        if (L.height >= 0) { m[L.height] = s.height; P[L.height * n + L.height] = sq(s.height_sigma); }
        if (L.turn >= 0) P[L.turn * n + L.turn] = sq(s.turn_sigma);
        if (L.scale >= 0) P[L.scale * n + L.scale] = sq(s.scale_sigma);
        if (L.bias >= 0) P[L.bias * n + L.bias] = sq(s.common_bias_sigma);
        for (int i = L.slot0; i < n; ++i) P[i * n + i] = 1e-12;
        for (int j = 0; j < s.modes; ++j) {
            b.mean[j] = m;
            b.cov[j] = P;
            b.mode_probability[j] = 1.0 / s.modes;
        }
        b.m = m;
        b.P = P;
    }

    // Moves the belief to time t; with `smoothing` also computes what pending rows need.
    void predict(Belief &b, double t, const std::vector<Reading> &scan, bool smoothing) {
        const int n = L.n;
        const double dt = t - b.t;
        mix(b, dt);
        // Distance, not time, makes correlated errors fade.
        double speed2 = 0;
        for (int i = 0; i < L.D; ++i) speed2 += sq(b.m[L.D + i]) + b.P[(L.D + i) * n + L.D + i];
        const double travelled = std::sqrt(speed2) * dt;
        std::vector<int> &fresh = scratch.fresh;
        fresh.clear();
        if (smoothing) { std::fill(scratch.C.begin(), scratch.C.end(), 0.0); }
        assign_slots(b, t, scan, fresh);
        for (int j = 0; j < s.modes; ++j) propagate(b, j, dt, travelled, fresh, smoothing);
        b.t = t;
        if (smoothing) {
            combine(b);
            scratch.m_pred = b.m;
            scratch.P_pred = b.P;
            smoother_gain();
        }
    }

    // Conditions on the readings of one time, all modes; returns the log-likelihood of the scan.
    void update(Belief &b, const std::vector<Reading> &scan, bool smoothing) {
        double loglik[kMaxModes], best = -1e300;
        condition(b, scan, loglik);
        for (int j = 0; j < s.modes; ++j) best = std::max(best, loglik[j]);
        double total = 0;
        for (int j = 0; j < s.modes; ++j)
            total += (b.mode_probability[j] = std::max(b.mode_probability[j] * std::exp(loglik[j] - best), 1e-12));
        for (int j = 0; j < s.modes; ++j) b.mode_probability[j] /= total;
        combine(b);
        learn(b, scan);
        b.last_update = b.t;
        ++b.step;
        if (smoothing) smooth(b);
    }

    void linearize(const double *x, int32_t sensor, const Belief &b, Jacobian &H) const {
        const SensorModel &a = sensors_[sensor];
        const int D = L.D;
        double d[3] = {x[0] - a.x, x[1] - a.y, 0};
        d[2] = (D == 3 ? x[2] : (L.height >= 0 ? x[L.height] : s.height)) - a.z;
        double r = std::sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
        r = std::max(r, 1e-9);
        H.count = 0;
        H.distance = r;
        double k = 1 + a.scale;
        if (L.scale >= 0) k += x[L.scale];
        double h = k * r + a.bias;
        const double kr = k / r;
        H.add(0, kr * d[0]);
        H.add(1, kr * d[1]);
        if (D == 3) H.add(2, kr * d[2]);
        if (L.height >= 0) H.add(L.height, kr * d[2]);
        if (L.scale >= 0) H.add(L.scale, r);
        if (L.bias >= 0) { h += x[L.bias]; H.add(L.bias, 1); }
        if (L.per_slot) {
            const int slot = slot_of(b, sensor);
            if (slot >= 0) {
                const int base = L.slot0 + slot * L.per_slot;
                if (L.slot_bias >= 0) { h += x[base + L.slot_bias]; H.add(base + L.slot_bias, 1); }
                if (L.slot_correlated >= 0) { h += x[base + L.slot_correlated]; H.add(base + L.slot_correlated, 1); }
            }
        }
        H.expected = h;
    }

    // The same where only the horizontal position is unknown.
    void linearize_plain(const double *x, int32_t sensor, Jacobian &H) const {
        const SensorModel &a = sensors_[sensor];
        const double dx = x[0] - a.x, dy = x[1] - a.y, dz = s.height - a.z;
        const double r = std::max(std::sqrt(dx * dx + dy * dy + dz * dz), 1e-9);
        const double k = 1 + a.scale, kr = k / r;
        H.index[0] = 0;
        H.index[1] = 1;
        H.value[0] = kr * dx;
        H.value[1] = kr * dy;
        H.count = 2;
        H.distance = r;
        H.expected = k * r + a.bias;
    }

    // White variance of a reading: the model's, times what was learned, or what the sensor said. A
    // sensor without a slot has its own errors in it.
    double variance(const Belief &b, const Reading &z, double r) const {
        const SensorModel &a = sensors_[z.sensor];
        double v = (z.sigma > 0 ? said(z) : a.variance) + a.scale_variance * r * r;
        if (a.learn && !(z.sigma > 0)) v = std::max(v * factor(b, z.sensor), sq(s.noise_floor));
        if (L.per_slot && slot_of(b, z.sensor) < 0) {
            if (L.slot_bias >= 0) v += sq(a.bias_sigma);
            if (L.slot_correlated >= 0) v += correlated_variance(b, a);
        }
        return v;
    }

    // What a sensor said of its noise, within what arithmetic bears: 1 mm to 1000 km.
    static double said(const Reading &z) { return sq(std::clamp(double(z.sigma), kLeastSigma, 1e6)); }

    void combine(Belief &b) const {
        switch (L.n) {
            case 4: return combine_sized<4>(b);
            case 5: return combine_sized<5>(b);
            case 6: return combine_sized<6>(b);
            default: return combine_sized<0>(b);
        }
    }

    template <int N>
    void combine_sized(Belief &b) const {
        const int n = N ? N : L.n, nn = n * n;
        if (s.modes == 1) { b.m = b.mean[0]; b.P = b.cov[0]; return; }
        b.m.assign(n, 0.0);
        b.P.assign(nn, 0.0);
        for (int j = 0; j < s.modes; ++j)
            for (int i = 0; i < n; ++i) b.m[i] += b.mode_probability[j] * b.mean[j][i];
        for (int j = 0; j < s.modes; ++j) {
            const double w = b.mode_probability[j];
            for (int i = 0; i < n; ++i) {
                const double di = w * (b.mean[j][i] - b.m[i]);
                const double *c = &b.cov[j][i * n];
                double *p = &b.P[i * n];
                for (int k = i; k < n; ++k) p[k] += w * c[k] + di * (b.mean[j][k] - b.m[k]);
            }
        }
        for (int i = 1; i < n; ++i)
            for (int k = 0; k < i; ++k) b.P[i * n + k] = b.P[k * n + i];
    }

    static double sq(double v) { return v * v; }

    int slot_of(const Belief &b, int32_t sensor) const {
        for (int i = 0; i < s.slots; ++i)
            if (b.slots[i].sensor == sensor) return i;
        return -1;
    }

  private:
    double factor(const Belief &b, int32_t sensor) const {
        // Shrunk towards the pool, which is shrunk towards the model.
        const int i = slot_of(b, sensor);
        if (i < 0) return pool(b);
        return (s.pool_weight * pool(b) + b.slots[i].power) / (s.pool_weight + b.slots[i].weight);
    }

    // Where noise is learned, the correlated part is taken to grow with the white one.
    double correlated_variance(const Belief &b, const SensorModel &a) const {
        return sq(a.correlated_sigma) * (a.learn ? pool(b) : 1.0);
    }

    double pool(const Belief &b) const {
        return (s.prior_weight + b.pool_power) / (s.prior_weight + b.pool_weight);
    }

    void assign_slots(Belief &b, double t, const std::vector<Reading> &scan, std::vector<int> &fresh) const {
        for (const Reading &z : scan) {
            int i = slot_of(b, z.sensor);
            if (i < 0) {
                for (int k = 0; k < s.slots; ++k)
                    if (b.slots[k].sensor < 0 || t - b.slots[k].last > s.slot_idle)
                        if (i < 0 || b.slots[k].last < b.slots[i].last) i = k;
                if (i < 0) continue;
                b.slots[i] = Slot{};
                b.slots[i].sensor = z.sensor;
                fresh.push_back(i);
            }
            b.slots[i].last = t;
        }
    }

    void mix(Belief &b, double dt) {
        switch (L.n) {
            case 4: return mix_sized<4>(b, dt);
            case 5: return mix_sized<5>(b, dt);
            case 6: return mix_sized<6>(b, dt);
            default: return mix_sized<0>(b, dt);
        }
    }

    template <int N>
    void mix_sized(Belief &b, double dt) {
        const int M = s.modes, n = N ? N : L.n;
        if (M == 1) {
            scratch.mix_mean[0] = b.mean[0];
            scratch.mix_cov[0] = b.cov[0];
            return;
        }
        double T[kMaxModes][kMaxModes], c[kMaxModes] = {};
        for (int i = 0; i < M; ++i) {
            const double leave = (1 - std::exp(-s.mode[i].switch_rate * dt)) * (M - 1) / M;
            for (int j = 0; j < M; ++j) T[i][j] = i == j ? 1 - leave : leave / (M - 1);
        }
        for (int j = 0; j < M; ++j)
            for (int i = 0; i < M; ++i) c[j] += T[i][j] * b.mode_probability[i];
        for (int j = 0; j < M; ++j) {
            double w[kMaxModes];
            for (int i = 0; i < M; ++i) w[i] = T[i][j] * b.mode_probability[i] / c[j];
            double *m = scratch.mix_mean[j].data(), *P = scratch.mix_cov[j].data();
            for (int k = 0; k < n; ++k) {
                m[k] = 0;
                for (int i = 0; i < M; ++i) m[k] += w[i] * b.mean[i][k];
            }
            std::fill(P, P + n * n, 0.0);
            for (int i = 0; i < M; ++i) {
                const double *mi = b.mean[i].data(), *Pi = b.cov[i].data();
                for (int r = 0; r < n; ++r) {
                    const double dr = w[i] * (mi[r] - m[r]);
                    for (int k = r; k < n; ++k) P[r * n + k] += w[i] * Pi[r * n + k] + dr * (mi[k] - m[k]);
                }
            }
            for (int r = 1; r < n; ++r)
                for (int k = 0; k < r; ++k) P[r * n + k] = P[k * n + r];
        }
        for (int j = 0; j < M; ++j) b.mode_probability[j] = c[j];
    }

    // Mean and covariance of one mode over dt: in short steps where the mode turns, since a turn
    // bends the path within a step. `cross` ends as cov(x before, x after).
    void propagate(Belief &b, int j, double dt, double travelled, const std::vector<int> &fresh, bool smoothing) {
        // A long silence begins like a short one, so that doubt never shrinks while it lasts.
        const double known = std::min(dt, s.turn_max_step);
        const bool turning = s.mode[j].turns && L.turn >= 0;
        b.mean[j] = scratch.mix_mean[j];
        std::vector<double> &P = scratch.mix_cov[j];
        if (smoothing) scratch.X = P;
        const int steps = turning ? std::max(1, int(std::ceil(known / s.turn_step - 1e-9))) : 1;
        for (int k = 0; k < steps; ++k) move(b.mean[j], P, s.mode[j], known / steps, turning, false, smoothing);
        if (dt > known) move(b.mean[j], P, s.mode[j], dt - known, false, true, smoothing);
        refresh(b, b.mean[j], P, dt, travelled, fresh, smoothing);
        if (smoothing) accumulate_cross(b, j, scratch.mix_mean[j], b.mean[j], scratch.X);
        b.cov[j].swap(P);
    }

    // One step of the kinematic block [p, v, turn]: velocity forgets itself and turns.
    void move(std::vector<double> &m, std::vector<double> &P, const Mode &mode, double dt, bool turning, bool outage,
              bool smoothing) {
        const int n = L.n, D = L.D;
        const double beta = 1 / (outage ? s.outage_velocity_time : s.velocity_time);
        const double omega = turning ? m[L.turn] : 0;
        const std::complex<double> lambda(-beta, omega);
        const std::complex<double> e = std::exp(lambda * dt);
        const std::complex<double> g = (e - 1.0) / lambda;  // position gained per velocity
        // The horizontal plane as complex numbers: rotation and decay in one.
        const std::complex<double> v(m[D], m[D + 1]);
        const std::complex<double> dp = g * v, nv = e * v;
        m[0] += dp.real();
        m[1] += dp.imag();
        m[D] = nv.real();
        m[D + 1] = nv.imag();
        const double ed = std::exp(-beta * dt), gd = (1 - ed) / beta;
        if (D == 3) { m[2] += gd * m[5]; m[5] *= ed; }
        double turn_decay = 1, turn_noise = 0;
        std::complex<double> g_turn = 0, e_turn = 0;  // slopes of the position and the velocity in the turn rate
        if (L.turn >= 0) {
            turn_decay = std::exp(-dt / s.turn_time);
            turn_noise = sq(s.turn_sigma) * (1 - sq(turn_decay));
            m[L.turn] *= turn_decay;
            if (turning) {
                const std::complex<double> i1(0, 1);
                e_turn = i1 * dt * e * v;
                g_turn = i1 * (dt * e * lambda - (e - 1.0)) / (lambda * lambda) * v;
            }
        }
        // Q <- F Q along one side; `row` and `col` are the strides of the side and across it.
        auto apply = [&](double *Q, int row, int col) {
            for (int c = 0; c < n; ++c, Q += col) {
                double *x = Q, *y = Q + row, *vx = Q + D * row, *vy = Q + (D + 1) * row;
                const double u = *vx, w = *vy;
                *x += g.real() * u - g.imag() * w;
                *y += g.imag() * u + g.real() * w;
                *vx = e.real() * u - e.imag() * w;
                *vy = e.imag() * u + e.real() * w;
                if (D == 3) { Q[2 * row] += gd * Q[5 * row]; Q[5 * row] *= ed; }
                if (L.turn < 0) continue;
                double *o = Q + L.turn * row;
                *x += g_turn.real() * *o;
                *y += g_turn.imag() * *o;
                *vx += e_turn.real() * *o;
                *vy += e_turn.imag() * *o;
                *o *= turn_decay;
            }
        };
        apply(P.data(), 1, n);
        apply(P.data(), n, 1);
        if (smoothing) apply(scratch.X.data(), 1, n);
        // Noise of the integrated Ornstein-Uhlenbeck velocity, exact without turning.
        const double q = mode.accel_density, x = beta * dt;
        const double vv = q * (1 - ed * ed) / (2 * beta);
        const double pv = q * sq(1 - ed) / (2 * beta * beta);
        const double pp = x < 0.02 ? q * dt * dt * dt / 3 * (1 - 0.75 * x)
                                   : q / (beta * beta * beta) * (x - 2 * (1 - ed) + 0.5 * (1 - ed * ed));
        for (int i = 0; i < D; ++i) {
            P[i * n + i] += pp;
            P[i * n + D + i] += pv;
            P[(D + i) * n + i] += pv;
            P[(D + i) * n + D + i] += vv;
        }
        if (L.turn >= 0) P[L.turn * n + L.turn] += turn_noise;
    }

    // The other states: height returns to its prior, correlated errors fade with distance, a slot
    // given to another sensor starts afresh.
    void refresh(const Belief &b, std::vector<double> &m, std::vector<double> &P, double dt, double travelled,
                 const std::vector<int> &fresh, bool smoothing) {
        const int n = L.n;
        auto fade = [&](int at, double f) {
            m[at] *= f;
            double *row = &P[at * n];
            for (int c = 0; c < n; ++c) row[c] *= f;
            for (int c = 0; c < n; ++c) P[c * n + at] *= f;
            if (smoothing)
                for (int c = 0; c < n; ++c) scratch.X[c * n + at] *= f;
        };
        if (L.height >= 0) {
            const double f = std::exp(-dt / s.height_time);
            m[L.height] -= s.height;
            fade(L.height, f);
            m[L.height] += s.height;
            P[L.height * (n + 1)] += sq(s.height_sigma) * (1 - f * f);
        }
        if (L.slot_correlated >= 0)
            for (int i = 0; i < s.slots; ++i) {
                if (b.slots[i].sensor < 0) continue;
                const SensorModel &a = sensors_[b.slots[i].sensor];
                const double f = std::exp(-travelled / a.correlation_length);
                const int at = L.slot0 + i * L.per_slot + L.slot_correlated;
                fade(at, f);
                P[at * (n + 1)] += correlated_variance(b, a) * (1 - f * f);
            }
        for (int i : fresh) {
            const SensorModel &a = sensors_[b.slots[i].sensor];
            const int base = L.slot0 + i * L.per_slot;
            for (int o = 0; o < L.per_slot; ++o) {
                fade(base + o, 0);
                P[(base + o) * (n + 1)] = (o == L.slot_bias ? sq(a.bias_sigma) : correlated_variance(b, a)) + 1e-12;
            }
        }
    }

    // C += w_j (P0j Fj' + (m0j - m)(mj' - m')'): the second mean is centred later, since the sum
    // of w_j (m0j - m) is zero any constant may stand there.
    void accumulate_cross(const Belief &b, int j, const std::vector<double> &m0, const std::vector<double> &m1,
                          const std::vector<double> &PFt) {
        const int n = L.n;
        const double w = b.mode_probability[j];
        for (int r = 0; r < n; ++r) {
            const double dr = w * (m0[r] - b.m[r]);
            for (int c = 0; c < n; ++c) scratch.C[r * n + c] += w * PFt[r * n + c] + dr * m1[c];
        }
    }

    // G = C P_pred^-1, (n, n), by Cholesky.
    void smoother_gain() {
        const int n = L.n;
        std::vector<double> &A = scratch.chol;
        A = scratch.P_pred;
        for (int i = 0; i < n; ++i) A[i * n + i] += 1e-12;
        for (int c = 0; c < n; ++c) {
            double d = A[c * n + c];
            for (int k = 0; k < c; ++k) d -= sq(A[c * n + k]);
            d = std::sqrt(std::max(d, 1e-300));
            A[c * n + c] = d;
            for (int r = c + 1; r < n; ++r) {
                double v = A[r * n + c];
                for (int k = 0; k < c; ++k) v -= A[r * n + k] * A[c * n + k];
                A[r * n + c] = v / d;
            }
        }
        for (int r = 0; r < n; ++r) {
            double *g = &scratch.G[r * n];
            const double *c = &scratch.C[r * n];
            for (int i = 0; i < n; ++i) {
                double v = c[i];
                for (int k = 0; k < i; ++k) v -= A[i * n + k] * g[k];
                g[i] = v / A[i * n + i];
            }
            for (int i = n - 1; i >= 0; --i) {
                double v = g[i];
                for (int k = i + 1; k < n; ++k) v -= A[k * n + i] * g[k];
                g[i] = v / A[i * n + i];
            }
        }
    }

  public:
    // Pending rows learn from the step just taken: x_k += Phi (x+ - x-), Phi = G_k ... G_{j-1}.
    void smooth(Belief &b) {
        const int n = L.n, W = 2 * L.D;
        std::vector<double> &dP = scratch.A;
        for (int i = 0; i < n; ++i) scratch.d[i] = b.m[i] - scratch.m_pred[i];
        for (int i = 0; i < n * n; ++i) dP[i] = b.P[i] - scratch.P_pred[i];
        std::vector<double> next(size_t(W) * n), half(size_t(W) * n);
        for (Pending &p : b.pending) {
            for (int r = 0; r < W; ++r) {
                double *o = &next[r * n];
                std::fill(o, o + n, 0.0);
                for (int k = 0; k < n; ++k) {
                    const double f = p.gain[r * n + k];
                    const double *g = &scratch.G[k * n];
                    for (int c = 0; c < n; ++c) o[c] += f * g[c];
                }
                for (int c = 0; c < n; ++c) p.mean[r] += o[c] * scratch.d[c];
                double *h = &half[r * n];
                std::fill(h, h + n, 0.0);
                for (int k = 0; k < n; ++k)
                    for (int c = 0; c < n; ++c) h[c] += o[k] * dP[k * n + c];
            }
            for (int r = 0; r < W; ++r)
                for (int q = 0; q < W; ++q) {
                    double sum = 0;
                    for (int c = 0; c < n; ++c) sum += half[r * n + c] * next[q * n + c];
                    p.cov[r * W + q] += sum;
                }
            p.gain.swap(next);
            next.resize(size_t(W) * n);
        }
    }

  private:
    // One mode on its way through the readings of a scan.
    struct Lane {
        std::vector<double> x, P, x_lin, PH;
        double loglik = 0, product = 1;
        double bend = 1e300;  // least R r^2 of the scan
        bool settled = false;
    };
    Lane lanes_[kMaxModes];

    // Iterated update of all modes by the readings of one time; their log-likelihoods.
    void condition(Belief &b, const std::vector<Reading> &scan, double *loglik) {
        // A size known to the compiler unrolls the small loops; so does a slope with two entries.
        const bool plain = L.D == 2 && L.height < 0 && L.scale < 0 && L.bias < 0 && L.per_slot == 0;
        if (plain && L.n == 4) return condition_sized<4, true>(b, scan, loglik);
        if (plain && L.n == 5) return condition_sized<5, true>(b, scan, loglik);
        return condition_sized<0, false>(b, scan, loglik);
    }

    template <int N, bool Plain>
    void condition_sized(Belief &b, const std::vector<Reading> &scan, double *loglik) {
        const int n = N ? N : L.n;
        double share[3];
        shares(b, share);
        for (int j = 0; j < s.modes; ++j) {
            lanes_[j].settled = false;
            std::copy(b.mean[j].begin(), b.mean[j].end(), lanes_[j].x_lin.begin());
        }
        for (int it = 0; it < s.iterations; ++it) {
            bool all = true;
            for (int j = 0; j < s.modes; ++j) {
                Lane &a = lanes_[j];
                if (a.settled) continue;
                all = false;
                std::copy(b.mean[j].begin(), b.mean[j].end(), a.x.begin());
                std::copy(b.cov[j].begin(), b.cov[j].end(), a.P.begin());
                a.loglik = 0;
                a.product = 1;
                a.bend = 1e300;
            }
            if (all) break;
            // Modes inside readings: each is a long chain of operations, and they run side by side.
            for (const Reading &z : scan)
                for (int j = 0; j < s.modes; ++j)
                    if (!lanes_[j].settled) absorb<N, Plain>(lanes_[j], b, z, share);
            for (int j = 0; j < s.modes; ++j) {
                Lane &a = lanes_[j];
                if (a.settled) continue;
                a.loglik += std::log(std::max(a.product, 1e-300));
                double moved = 0;
                for (int i = 0; i < L.D; ++i) moved += sq(a.x[i] - a.x_lin[i]);
                std::copy(a.x.begin(), a.x.begin() + n, a.x_lin.begin());
                // What linearizing left out is moved / (2 r): far below the noise, another round is idle.
                a.settled = sq(moved) < 4 * sq(0.02) * a.bend;
            }
        }
        for (int j = 0; j < s.modes; ++j) {
            b.mean[j].swap(lanes_[j].x);
            b.cov[j].swap(lanes_[j].P);
            loglik[j] = lanes_[j].loglik;
        }
    }

    // One reading, linearized at x_lin, into x and P.
    template <int N, bool Plain>
    void absorb(Lane &a, const Belief &b, const Reading &z, const double *share) {
        const int n = N ? N : L.n;
        double *x = a.x.data(), *P = a.P.data(), *PH = a.PH.data(), *x_lin = a.x_lin.data();
        Jacobian H;
        if constexpr (Plain)
            linearize_plain(x_lin, z.sensor, H);
        else
            linearize(x_lin, z.sensor, b, H);
        const int count = Plain ? 2 : H.count;
        double e = z.value - H.expected;
        for (int k = 0; k < count; ++k) e -= H.value[k] * (x[H.index[k]] - x_lin[H.index[k]]);
        const double *p0 = P + H.index[0] * n, *p1 = P + H.index[1] * n;
        for (int c = 0; c < n; ++c) PH[c] = H.value[0] * p0[c] + H.value[1] * p1[c];
        for (int k = 2; k < count; ++k) {
            const double *p = P + H.index[k] * n;
            for (int c = 0; c < n; ++c) PH[c] += H.value[k] * p[c];
        }
        double hph = 0;
        for (int k = 0; k < count; ++k) hph += H.value[k] * PH[H.index[k]];
        const double R = variance(b, z, H.distance);
        a.bend = std::min(a.bend, R * H.distance * H.distance);
        double gain, shrink;
        a.product *= weigh(share, e, hph, R, gain, shrink);
        if (a.product < 1e-200 || a.product > 1e200) {
            a.loglik += std::log(std::max(a.product, 1e-300));
            a.product = 1;
        }
        for (int c = 0; c < n; ++c) x[c] += gain * PH[c];
        for (int r = 0; r < n; ++r) {
            const double f = shrink * PH[r];
            double *p = P + r * n;
            for (int c = 0; c < n; ++c) p[c] -= f * PH[c];
        }
    }

    // Collapses the mixture line of sight / late (NLOS) / outlier to its first two moments:
    // x += gain PH', P -= shrink (PH')(PH')'. Returns the mixture's predictive density.
    double weigh(const double *share, double e, double hph, double R, double &gain, double &shrink) const {
        const double S0 = hph + R, inv0 = 1 / S0;
        constexpr double norm = 0.3989422804014327;  // 1 / sqrt(2 pi)
        if (!s.robust) {
            gain = e * inv0;
            shrink = inv0;
            return norm * std::exp(-0.5 * e * gain) * std::sqrt(inv0);
        }
        const double sigma = std::sqrt(R), late = s.nlos_sigmas * sigma;
        const double inv1 = 1 / (S0 + late * late), inv2 = 1 / (S0 + sq(s.outlier_sigmas) * R);
        const double u0 = e * inv0, u1 = (e - late) * inv1, u2 = e * inv2;
        double w0 = share[0] * std::exp(-0.5 * e * u0) * std::sqrt(inv0);
        double w1 = share[1] * std::exp(-0.5 * (e - late) * u1) * std::sqrt(inv1);
        double w2 = share[2] * std::exp(-0.5 * e * u2) * std::sqrt(inv2);
        const double sum = w0 + w1 + w2 + 1e-280;
        w0 /= sum;
        w1 /= sum;
        w2 /= sum;
        gain = w0 * u0 + w1 * u1 + w2 * u2;
        const double second = w0 * u0 * u0 + w1 * u1 * u1 + w2 * u2 * u2;
        shrink = w0 * inv0 + w1 * inv1 + w2 * inv2 - (second - gain * gain);
        return norm * sum;
    }

    // Residual power of the posterior plus H P H', weighted by what the reading could tell.
    void learn(Belief &b, const std::vector<Reading> &scan) {
        const int n = L.n;
        for (const Reading &z : scan) {
            const SensorModel &a = sensors_[z.sensor];
            if (!a.learn || z.sigma > 0) continue;
            Jacobian H;
            linearize(b.m.data(), z.sensor, b, H);
            const double e = z.value - H.expected;
            const double hph = H.spread(b.P.data(), n);
            const double model = a.variance + a.scale_variance * H.distance * H.distance;
            const double R = variance(b, z, H.distance);
            const double S = R + hph;
            double weight = R / S;
            if (s.robust) {
                const double late = s.nlos_sigmas * std::sqrt(R);
                double p[3];
                shares(b, p);
                const double l0 = p[0] * density(e, S);
                const double l1 = p[1] * density(e - late, S + late * late);
                const double l2 = p[2] * density(e, S + sq(s.outlier_sigmas) * R);
                const double sum = std::max(l0 + l1 + l2, 1e-300);
                const double told = R / S;  // a wide prediction says nothing about the noise
                b.heard += told - b.heard / s.memory_shares;
                b.heard_nlos += told * l1 / sum - b.heard_nlos / s.memory_shares;
                b.heard_outlier += told * l2 / sum - b.heard_outlier / s.memory_shares;
                weight *= l0 / sum;
            }
            // No sensor is ten times as bad as its model; what seems so is a lost track.
            const double power = std::min((e * e + hph) / model, s.worst_factor);
            b.pool_weight += weight - b.pool_weight / s.memory_pool;
            b.pool_power += weight * power - b.pool_power / s.memory_pool;
            const int i = slot_of(b, z.sensor);
            if (i >= 0) {
                Slot &o = b.slots[i];
                o.weight += weight - o.weight / s.memory_own;
                o.power += weight * power - o.power / s.memory_own;
            }
        }
    }

    // Shares of line of sight, late and outlying readings: the prior's and what was heard since.
    void shares(const Belief &b, double *p) const {
        const double k = s.shares_weight;
        p[1] = std::min((k * s.p_nlos + b.heard_nlos) / (k + b.heard), 0.5);
        p[2] = std::min((k * s.p_outlier + b.heard_outlier) / (k + b.heard), 0.3);
        p[0] = 1 - p[1] - p[2];
    }

    static double density(double e, double S) { return std::exp(-0.5 * e * e / S) / std::sqrt(S); }
};

}  // namespace trackfield
