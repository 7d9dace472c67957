// The belief about one target, and the small values that pass through the filter.
#pragma once

#include "settings.hpp"

namespace trackfield {

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

}  // namespace trackfield
