// A place to start from, without a prior: robust least squares from many starts.
#pragma once

#include "range_filter.hpp"

namespace trackfield {

struct Start {
    bool found = false;
    double position[3] = {0, 0, 0};
    double cov[9] = {};
    double cost = 1e300, rival = 1e300;  // rival: cost of the best place far from the best one
};

namespace detail {

// Solves A x = g for a small symmetric positive definite A (d <= 3); false if it is not.
inline bool solve_small(int d, const double *A, const double *g, double *x) {
    double Lw[9] = {};
    for (int c = 0; c < d; ++c)
        for (int r = c; r < d; ++r) {
            double v = A[r * d + c];
            for (int k = 0; k < c; ++k) v -= Lw[r * d + k] * Lw[c * d + k];
            if (r == c) {
                if (v <= 0) return false;
                Lw[c * d + c] = std::sqrt(v);
            } else
                Lw[r * d + c] = v / Lw[c * d + c];
        }
    double y[3];
    for (int i = 0; i < d; ++i) {
        y[i] = g[i];
        for (int k = 0; k < i; ++k) y[i] -= Lw[i * d + k] * y[k];
        y[i] /= Lw[i * d + i];
    }
    for (int i = d - 1; i >= 0; --i) {
        x[i] = y[i];
        for (int k = i + 1; k < d; ++k) x[i] -= Lw[k * d + i] * x[k];
        x[i] /= Lw[i * d + i];
    }
    return true;
}

}  // namespace detail

// Cauchy cost of standing still at p while the readings were taken; J' W J and J' W e on request.
inline double start_cost(const RangeFilter &f, const std::vector<Reading> &zs, double t, const double *p,
                         double *A = nullptr, double *g = nullptr) {
    const int D = f.L.D;
    if (A) std::fill(A, A + D * D, 0.0);
    if (g) std::fill(g, g + D, 0.0);
    double cost = 0;
    for (const Reading &z : zs) {
        const SensorModel &a = f.sensors_[z.sensor];
        const double d[3] = {p[0] - a.x, p[1] - a.y, (D == 3 ? p[2] : f.s.height) - a.z};
        const double r = std::max(std::sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]), 1e-9);
        const double k = 1 + a.scale;
        const double e = z.value - k * r - a.bias;
        const double moved = f.s.velocity_sigma * (t - z.t);
        double V = moved * moved + RangeFilter::sq(a.correlated_sigma) + RangeFilter::sq(a.bias_sigma) +
                   RangeFilter::sq(f.s.common_bias_sigma) + RangeFilter::sq(f.s.scale_sigma * r);
        V += z.sigma > 0 ? RangeFilter::said(z) : a.variance + a.scale_variance * r * r;
        if (f.s.height_open) V += RangeFilter::sq(f.s.height_sigma * d[2] / r);
        const double u = e * e / (4 * V);
        cost += 2 * std::log1p(u);
        if (A) {
            const double w = 1 / (V * (1 + u));
            double J[3];
            for (int i = 0; i < D; ++i) J[i] = k * d[i] / r;
            for (int i = 0; i < D; ++i) {
                g[i] += w * J[i] * e;
                for (int c = 0; c < D; ++c) A[i * D + c] += w * J[i] * J[c];
            }
        }
    }
    return cost;
}

inline double start_refine(const RangeFilter &f, const std::vector<Reading> &zs, double t, double *p) {
    const int D = f.L.D;
    double A[9], g[3], step[3], trial[3], damp = 1e-3;
    double cost = start_cost(f, zs, t, p, A, g);
    for (int it = 0; it < 25; ++it) {
        double B[9];
        std::copy(A, A + D * D, B);
        for (int i = 0; i < D; ++i) B[i * D + i] += damp * (A[i * D + i] + 1e-9);
        if (!detail::solve_small(D, B, g, step)) { damp *= 10; continue; }
        double len = 0;
        for (int i = 0; i < D; ++i) { trial[i] = p[i] + step[i]; len += step[i] * step[i]; }
        double A2[9], g2[3];
        const double c2 = start_cost(f, zs, t, trial, A2, g2);
        if (c2 < cost) {
            std::copy(trial, trial + D, p);
            std::copy(A2, A2 + D * D, A);
            std::copy(g2, g2 + D, g);
            cost = c2;
            damp = std::max(damp * 0.2, 1e-9);
            if (len < 1e-10) break;
        } else {
            damp *= 6;
            if (damp > 1e8) break;
        }
    }
    return cost;
}

// Best place for the readings. Starts: a grid over the sensors' box widened by the ranges.
inline Start find_start(const RangeFilter &f, const std::vector<Reading> &zs, double t) {
    Start out;
    const int D = f.L.D;
    double lo[3] = {1e300, 1e300, 1e300}, hi[3] = {-1e300, -1e300, -1e300};
    for (const Reading &z : zs) {
        const SensorModel &a = f.sensors_[z.sensor];
        const double c[3] = {a.x, a.y, a.z};
        for (int i = 0; i < 3; ++i) {
            const double reach = std::max(z.value, 0.0);
            lo[i] = std::min(lo[i], c[i] - reach);
            hi[i] = std::max(hi[i], c[i] + reach);
        }
    }
    std::vector<double> found;
    const int per_axis = D == 2 ? 7 : 4;
    const int total = D == 2 ? per_axis * per_axis : per_axis * per_axis * per_axis;
    std::vector<double> costs;
    for (int k = 0; k < total; ++k) {
        double p[3] = {0, 0, 0};
        int rest = k;
        for (int i = 0; i < D; ++i) {
            p[i] = lo[i] + (hi[i] - lo[i]) * ((rest % per_axis) + 0.5) / per_axis;
            rest /= per_axis;
        }
        const double c = start_refine(f, zs, t, p);
        costs.push_back(c);
        found.insert(found.end(), p, p + 3);
        if (c < out.cost) { out.cost = c; std::copy(p, p + 3, out.position); }
    }
    double A[9], g[3];
    start_cost(f, zs, t, out.position, A, g);
    for (int c = 0; c < D; ++c) A[c * D + c] += 1e-6;  // at most 1 km of doubt
    for (int i = 0; i < D; ++i) {
        double unit[3] = {0, 0, 0}, col[3];
        unit[i] = 1;
        if (!detail::solve_small(D, A, unit, col)) return out;
        for (int c = 0; c < D; ++c) out.cov[c * D + i] = col[c];
    }
    for (size_t k = 0; k < costs.size(); ++k) {
        double far = 0, spread = 0;
        for (int i = 0; i < D; ++i) { far += RangeFilter::sq(found[3 * k + i] - out.position[i]); spread += out.cov[i * D + i]; }
        if (far > 25 * spread + 1e-6) out.rival = std::min(out.rival, costs[k]);
    }
    out.found = std::isfinite(out.cost);
    return out;
}

}  // namespace trackfield
