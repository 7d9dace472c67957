// What no set can exceed: the merit is concave in the information, so its tangent is above it.
#pragma once

#include <functional>
#include <numeric>

#include "selection_field.hpp"

namespace trackfield::selection {

// What a selection may use: so many sensors, and for two rows a sum of costs.
struct Limits {
    int rows = 1;
    const double *costs = nullptr;
    double most[2] = {0, 0};

    double used(int row, int sensor) const { return row == 0 ? 1.0 : costs[sensor]; }
};

// merit(M_S) <= constant + sum over S of score <= bound for every set S within limits; a unit of
// costs is worth `price`.
template <int D>
struct Cut {
    double constant = 0, price = 0, bound = INFINITY;
    Packed<D> slope;  // gradient of the merit in the information

    double score(const double *g) const { return slope.quadratic(g); }
    bool sound() const { return std::isfinite(bound); }
};

// Sum of the k largest.
inline double top(std::vector<double> &scores, int k) {
    k = std::min<int>(k, int(scores.size()));
    std::nth_element(scores.begin(), scores.begin() + k, scores.end(), std::greater<>());
    return std::accumulate(scores.begin(), scores.begin() + k, 0.0);
}

// Tangent with the slope given, at the multiple of its point where the bound is least: for A with
// X = M^-1 and X^2 the slope, tr M_S^-1 >= (tr X)^2 / (tr X^2 P + most that a set can score).
template <int D>
Cut<D> tangent(const Packed<D> &slope, const Field<D> &field, const Limits &limits, const Packed<D> &prior, double price) {
    std::vector<double> scores(field.n);
    for (int i = 0; i < field.n; ++i) {
        scores[i] = slope.quadratic(field.gain(i, 0));
        if (!std::isfinite(scores[i])) return {};  // which bounds nothing
        if (limits.rows == 2) scores[i] = std::max(scores[i] - price * limits.costs[i], 0.0);
    }
    const double most = top(scores, int(limits.most[0])) + (limits.rows == 2 ? price * limits.most[1] : 0.0);
    const double reach = inner(slope, prior) + most;
    double factor = 1.0, constant = 0.0;
    if (field.criterion == Criterion::kTrace) {
        double trace = 0;
        for (double root : Spectrum<D>(slope).roots) trace += std::sqrt(std::max(root, 0.0));
        const double t = trace / reach;
        constant = -2.0 * t * trace;
        factor = t * t;
    } else if (field.criterion == Criterion::kDeterminant) {
        factor = D / reach;
        constant = -D * std::log(factor) - merit(slope, Criterion::kDeterminant) - D;
    }
    Cut<D> cut{constant + factor * inner(slope, prior), factor * price, constant + factor * reach, slope};
    for (double &x : cut.slope.a) x *= factor;
    return std::isfinite(cut.bound) ? cut : Cut<D>{};
}

}  // namespace trackfield::selection
