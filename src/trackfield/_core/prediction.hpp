// From one time to the next: modes mix, targets move, what is not known fades.
#pragma once

#include "range_filter.hpp"

namespace trackfield {

inline void RangeFilter::predict(Belief &b, double t, const std::vector<Reading> &scan, bool smoothing) {
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

inline void RangeFilter::assign_slots(Belief &b, double t, const std::vector<Reading> &scan, std::vector<int> &fresh) const {
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

inline void RangeFilter::mix(Belief &b, double dt) {
    switch (L.n) {
        case 4: return mix_sized<4>(b, dt);
        case 5: return mix_sized<5>(b, dt);
        case 6: return mix_sized<6>(b, dt);
        default: return mix_sized<0>(b, dt);
    }
}

template <int N>
void RangeFilter::mix_sized(Belief &b, double dt) {
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
        spread_sized<N>(b, w, m, P);
    }
    for (int j = 0; j < M; ++j) b.mode_probability[j] = c[j];
}

inline void RangeFilter::propagate(Belief &b, int j, double dt, double travelled, const std::vector<int> &fresh, bool smoothing) {
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

inline void RangeFilter::move(std::vector<double> &m, std::vector<double> &P, const Mode &mode, double dt, bool turning, bool outage,
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

inline void RangeFilter::refresh(const Belief &b, std::vector<double> &m, std::vector<double> &P, double dt, double travelled,
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

}  // namespace trackfield
