// How good a set of sensors is, the larger the better: A, D and E of its information.
#pragma once

#include "selection_matrix.hpp"

namespace trackfield::selection {

enum class Criterion { kTrace = 0, kDeterminant = 1, kSmallestRoot = 2 };

template <int D>
double smallest_root(const Packed<D> &m) {
    if constexpr (D == 1) return m(0, 0);
    if constexpr (D == 2) {
        const double half = 0.5 * (m(0, 0) + m(1, 1)), gap = 0.5 * (m(0, 0) - m(1, 1));
        return half - std::sqrt(gap * gap + m(1, 0) * m(1, 0));
    }
    return Spectrum<D>(m).smallest();
}

// -tr M^-1, log det M, or the smallest eigenvalue of M.
template <int D>
double merit(const Packed<D> &m, Criterion criterion) {
    if (criterion == Criterion::kSmallestRoot) return smallest_root(m);
    if constexpr (D == 2) {
        const double det = m(0, 0) * m(1, 1) - m(1, 0) * m(1, 0);
        if (!(det > 0.0)) return kNothing;
        return criterion == Criterion::kTrace ? -(m(0, 0) + m(1, 1)) / det : std::log(det);
    }
    Packed<D> l;
    if (!factor(m, l)) return kNothing;
    double value = 0;
    if (criterion == Criterion::kDeterminant) {
        double product = 1.0;
        for (int i = 0; i < D; ++i) product *= l(i, i);
        return -2.0 * std::log(product);
    }
    invert_factor(l);
    for (double x : l.a) value -= x * x;
    return value;
}

// What one sensor more makes of a set: the inverse once, then O(D^2) a sensor.
template <int D>
class Base {
  public:
    void prepare(const Packed<D> &information, Criterion criterion) {
        m_ = information;
        criterion_ = criterion;
        firm_ = false;
        if (criterion == Criterion::kSmallestRoot || D == 2) return;
        Packed<D> l;
        if (!factor(m_, l)) return;
        invert_factor(l);
        inverse_ = gram(l);
        trace_ = inverse_.trace();
        firm_ = trace_ * m_.trace() < kFirm;
        if (firm_ && criterion == Criterion::kDeterminant) value_ = merit(m_, criterion);
    }
    // Merit of M + g g'; outer is g g'.
    double with(const double *g, const Packed<D> &outer) const {
        if (!firm_) return merit(sum(m_, outer), criterion_);
        double step[D], gain = 1.0, square = 0.0;
        for (int i = 0; i < D; ++i) {
            step[i] = 0;
            for (int j = 0; j < D; ++j) step[i] += inverse_.both(i, j) * g[j];
            gain += step[i] * g[i];
            square += step[i] * step[i];
        }
        if (criterion_ == Criterion::kTrace) return square / gain - trace_;
        return value_ + std::log(gain);
    }

  private:
    static constexpr double kFirm = 1e8;  // beyond this condition differences of traces lose digits
    Packed<D> m_, inverse_;
    Criterion criterion_ = Criterion::kTrace;
    bool firm_ = false;
    double trace_ = 0, value_ = 0;
};

}  // namespace trackfield::selection
