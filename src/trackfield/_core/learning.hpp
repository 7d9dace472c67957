// What residuals tell of the noise, and of the shares of late and outlying readings.
#pragma once

#include "range_filter.hpp"

namespace trackfield {

inline double RangeFilter::factor(const Belief &b, int32_t sensor) const {
    // Shrunk towards the pool, which is shrunk towards the model.
    const int i = slot_of(b, sensor);
    if (i < 0) return pool(b);
    return (s.pool_weight * pool(b) + b.slots[i].power) / (s.pool_weight + b.slots[i].weight);
}

inline double RangeFilter::correlated_variance(const Belief &b, const SensorModel &a) const {
    return sq(a.correlated_sigma) * (a.learn ? pool(b) : 1.0);
}

inline double RangeFilter::pool(const Belief &b) const {
    return (s.prior_weight + b.pool_power) / (s.prior_weight + b.pool_weight);
}

inline void RangeFilter::learn(Belief &b, const std::vector<Reading> &scan) {
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

inline void RangeFilter::shares(const Belief &b, double *p) const {
    const double k = s.shares_weight;
    p[1] = std::min((k * s.p_nlos + b.heard_nlos) / (k + b.heard), 0.5);
    p[2] = std::min((k * s.p_outlier + b.heard_outlier) / (k + b.heard), 0.3);
    p[0] = 1 - p[1] - p[2];
}

}  // namespace trackfield
