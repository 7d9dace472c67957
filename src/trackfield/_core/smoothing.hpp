// Rows that wait for their lag learn from every later step.
#pragma once

#include "range_filter.hpp"

namespace trackfield {

inline void RangeFilter::accumulate_cross(const Belief &b, int j, const std::vector<double> &m0, const std::vector<double> &m1,
                      const std::vector<double> &PFt) {
    const int n = L.n;
    const double w = b.mode_probability[j];
    for (int r = 0; r < n; ++r) {
        const double dr = w * (m0[r] - b.m[r]);
        for (int c = 0; c < n; ++c) scratch.C[r * n + c] += w * PFt[r * n + c] + dr * m1[c];
    }
}

inline void RangeFilter::smoother_gain() {
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

inline void RangeFilter::smooth(Belief &b) {
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

}  // namespace trackfield
