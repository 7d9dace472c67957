// Conditioning on the readings of one time, all modes side by side.
#pragma once

#include "range_filter.hpp"

namespace trackfield {

inline void RangeFilter::update(Belief &b, const std::vector<Reading> &scan, bool smoothing) {
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

inline void RangeFilter::linearize(const double *x, int32_t sensor, const Belief &b, Jacobian &H) const {
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

inline void RangeFilter::linearize_plain(const double *x, int32_t sensor, Jacobian &H) const {
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

inline double RangeFilter::variance(const Belief &b, const Reading &z, double r) const {
    const SensorModel &a = sensors_[z.sensor];
    double v = (z.sigma > 0 ? said(z) : a.variance) + a.scale_variance * r * r;
    if (a.learn && !(z.sigma > 0)) v = std::max(v * factor(b, z.sensor), sq(s.noise_floor));
    if (L.per_slot && slot_of(b, z.sensor) < 0) {
        if (L.slot_bias >= 0) v += sq(a.bias_sigma);
        if (L.slot_correlated >= 0) v += correlated_variance(b, a);
    }
    return v;
}

inline void RangeFilter::combine(Belief &b) const {
    switch (L.n) {
        case 4: return combine_sized<4>(b);
        case 5: return combine_sized<5>(b);
        case 6: return combine_sized<6>(b);
        default: return combine_sized<0>(b);
    }
}

template <int N>
void RangeFilter::combine_sized(Belief &b) const {
    const int n = N ? N : L.n;
    if (s.modes == 1) { b.m = b.mean[0]; b.P = b.cov[0]; return; }
    b.m.assign(n, 0.0);
    b.P.resize(size_t(n) * n);
    for (int j = 0; j < s.modes; ++j)
        for (int i = 0; i < n; ++i) b.m[i] += b.mode_probability[j] * b.mean[j][i];
    spread_sized<N>(b, b.mode_probability, b.m.data(), b.P.data());
}

template <int N>
void RangeFilter::spread_sized(const Belief &b, const double *w, const double *m, double *P) const {
    const int n = N ? N : L.n;
    for (int r = 0; r < n; ++r)
        for (int k = r; k < n; ++k) {
            double sum = 0;
            for (int j = 0; j < s.modes; ++j) {
                const double *x = b.mean[j].data();
                sum += w[j] * (b.cov[j][r * n + k] + (x[r] - m[r]) * (x[k] - m[k]));
            }
            P[r * n + k] = P[k * n + r] = sum;
        }
}

inline void RangeFilter::condition(Belief &b, const std::vector<Reading> &scan, double *loglik) {
    // A size known to the compiler unrolls the small loops; so does a slope with two entries.
    const bool plain = L.D == 2 && L.height < 0 && L.scale < 0 && L.bias < 0 && L.per_slot == 0;
    if (plain && L.n == 4) return condition_sized<4, true>(b, scan, loglik);
    if (plain && L.n == 5) return condition_sized<5, true>(b, scan, loglik);
    return condition_sized<0, false>(b, scan, loglik);
}

template <int N, bool Plain>
void RangeFilter::condition_sized(Belief &b, const std::vector<Reading> &scan, double *loglik) {
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

template <int N, bool Plain>
void RangeFilter::absorb(Lane &a, const Belief &b, const Reading &z, const double *share) {
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

inline double RangeFilter::weigh(const double *share, double e, double hph, double R, double &gain, double &shrink) const {
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

}  // namespace trackfield
