// The belief about one tagged target, conditioned on ranges: prediction, iterated update, learning.
//
// State, in this order: position (D), velocity (D), then those of height, turn rate, scale error,
// common bias that the site leaves open, then per slot (a recently heard sensor) its own bias and
// its correlated error. Every mode of the IMM carries the same state; all matrices are row-major.
#pragma once

#include <complex>

#include "belief.hpp"

namespace trackfield {

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
    void predict(Belief &b, double t, const std::vector<Reading> &scan, bool smoothing);

    // Conditions all modes on the readings of one time.
    void update(Belief &b, const std::vector<Reading> &scan, bool smoothing);

    void linearize(const double *x, int32_t sensor, const Belief &b, Jacobian &H) const;

    // The same where only the horizontal position is unknown.
    void linearize_plain(const double *x, int32_t sensor, Jacobian &H) const;

    // White variance of a reading: the model's, times what was learned, or what the sensor said. A
    // sensor without a slot has its own errors in it.
    double variance(const Belief &b, const Reading &z, double r) const;

    // What a sensor said of its noise, within what arithmetic bears: 1 mm to 1000 km.
    static double said(const Reading &z) { return sq(std::clamp(double(z.sigma), kLeastSigma, 1e6)); }

    void combine(Belief &b) const;

    template <int N>
    void combine_sized(Belief &b) const;

    // P = sum_j w_j (P_j + (m_j - m)(m_j - m)'), over the modes.
    template <int N>
    void spread_sized(const Belief &b, const double *w, const double *m, double *P) const;

    static double sq(double v) { return v * v; }

    int slot_of(const Belief &b, int32_t sensor) const {
        for (int i = 0; i < s.slots; ++i)
            if (b.slots[i].sensor == sensor) return i;
        return -1;
    }

  private:
    double factor(const Belief &b, int32_t sensor) const;

    // Where noise is learned, the correlated part is taken to grow with the white one.
    double correlated_variance(const Belief &b, const SensorModel &a) const;

    double pool(const Belief &b) const;

    void assign_slots(Belief &b, double t, const std::vector<Reading> &scan, std::vector<int> &fresh) const;

    void mix(Belief &b, double dt);

    template <int N>
    void mix_sized(Belief &b, double dt);

    // Mean and covariance of one mode over dt: in short steps where the mode turns, since a turn
    // bends the path within a step. `cross` ends as cov(x before, x after).
    void propagate(Belief &b, int j, double dt, double travelled, const std::vector<int> &fresh, bool smoothing);

    // One step of the kinematic block [p, v, turn]: velocity forgets itself and turns.
    void move(std::vector<double> &m, std::vector<double> &P, const Mode &mode, double dt, bool turning, bool outage,
              bool smoothing);

    // The other states: height returns to its prior, correlated errors fade with distance, a slot
    // given to another sensor starts afresh.
    void refresh(const Belief &b, std::vector<double> &m, std::vector<double> &P, double dt, double travelled,
                 const std::vector<int> &fresh, bool smoothing);

    // C += w_j (P0j Fj' + (m0j - m)(mj' - m')'): the second mean is centred later, since the sum
    // of w_j (m0j - m) is zero any constant may stand there.
    void accumulate_cross(const Belief &b, int j, const std::vector<double> &m0, const std::vector<double> &m1,
                          const std::vector<double> &PFt);

    // G = C P_pred^-1, (n, n), by Cholesky.
    void smoother_gain();

  public:
    // Pending rows learn from the step just taken: x_k += Phi (x+ - x-), Phi = G_k ... G_{j-1}.
    void smooth(Belief &b);

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
    void condition(Belief &b, const std::vector<Reading> &scan, double *loglik);

    template <int N, bool Plain>
    void condition_sized(Belief &b, const std::vector<Reading> &scan, double *loglik);

    // One reading, linearized at x_lin, into x and P.
    template <int N, bool Plain>
    void absorb(Lane &a, const Belief &b, const Reading &z, const double *share);

    // Collapses the mixture line of sight / late (NLOS) / outlier to its first two moments:
    // x += gain PH', P -= shrink (PH')(PH')'. Returns the mixture's predictive density.
    double weigh(const double *share, double e, double hph, double R, double &gain, double &shrink) const;

    // Residual power of the posterior plus H P H', weighted by what the reading could tell.
    void learn(Belief &b, const std::vector<Reading> &scan);

    // Shares of line of sight, late and outlying readings: the prior's and what was heard since.
    void shares(const Belief &b, double *p) const;

    static double density(double e, double S) { return std::exp(-0.5 * e * e / S) / std::sqrt(S); }
};

}  // namespace trackfield

#include "learning.hpp"
#include "prediction.hpp"
#include "smoothing.hpp"
#include "update.hpp"
