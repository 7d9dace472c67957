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
    if constexpr (D == 3) {
        const double a = m(1, 1) * m(2, 2) - m(2, 1) * m(2, 1), b = m(1, 0) * m(2, 2) - m(2, 0) * m(2, 1), c = m(1, 0) * m(2, 1) - m(2, 0) * m(1, 1);
        const double det = m(0, 0) * a - m(1, 0) * b + m(2, 0) * c;
        if (!(det > 0.0)) return kNothing;
        if (criterion == Criterion::kDeterminant) return std::log(det);
        return -(a + m(0, 0) * (m(1, 1) + m(2, 2)) - m(1, 0) * m(1, 0) - m(2, 0) * m(2, 0)) / det;
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

// What one sensor more makes of a set: the inverse or the spectrum once, then O(D^2) a sensor.
template <int D>
class Base {
  public:
    void prepare(const Packed<D> &information, Criterion criterion) {
        m_ = information;
        criterion_ = criterion;
        firm_ = false;
        if (D <= 2) return;
        if (criterion == Criterion::kSmallestRoot) {
            const Spectrum<D> spectrum(m_);
            roots_ = spectrum.roots;
            axes_ = spectrum.axes;
            return;
        }
        Packed<D> l;
        if (!factor(m_, l)) return;
        invert_factor(l);
        inverse_ = gram(l);
        trace_ = inverse_.trace();
        firm_ = trace_ * m_.trace() < kFirm;
        if (firm_ && criterion == Criterion::kDeterminant) value_ = merit(m_, criterion);
    }
    // Merit of M + g g', or anything less than `floor` if it is that; outer is g g'.
    double with(const double *g, const Packed<D> &outer, double floor) const {
        if (D > 2 && criterion_ == Criterion::kSmallestRoot && below(g, floor)) return kNothing;
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

    // Whether the smallest eigenvalue of M + g g' is below: by the secular equation, without it.
    bool below(const double *g, double floor) const {
        double secular = 1.0;
        int under = 0;
        for (int a = 0; a < D; ++a) {
            double along = 0;
            for (int i = 0; i < D; ++i) along += axes_[i * D + a] * g[i];
            const double gap = roots_[a] == floor ? -1e-300 : roots_[a] - floor;
            secular += along * along / gap;
            under += gap < 0;
        }
        return under > 1 || (under == 1 && !(secular < 0.0));
    }

    Packed<D> m_, inverse_;
    Criterion criterion_ = Criterion::kTrace;
    bool firm_ = false;
    double trace_ = 0, value_ = 0;
    std::array<double, D> roots_{};
    std::array<double, D * D> axes_{};
};

}  // namespace trackfield::selection
