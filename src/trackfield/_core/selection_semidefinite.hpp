// The smallest eigenvalue as a semidefinite constraint: max t with M - t I positive semidefinite.
#pragma once

#include "selection_matrix.hpp"

namespace trackfield::selection {

// What an interior-point method keeps of it: Y = M - t I and its multiplier Z, tr Z = 1, with the
// scaling of Nesterov and Todd, W Z W = Y, so that dZ = barrier Y^-1 - Z - W^-1 dY W^-1.
template <int D>
class Semidefinite {
  public:
    void begin(const Packed<D> &information) {
        const Spectrum<D> spectrum(information);
        const double room = 0.5 * spectrum.largest();
        t_ = spectrum.smallest() - room;
        y_ = information;
        for (int a = 0; a < D; ++a) y_(a, a) -= t_;
        Packed<D> l;
        factor(y_, l);
        invert_factor(l);
        z_ = gram(l);
        const double sum = z_.trace();
        for (double &x : z_.a) x /= sum;
    }
    double gap() const { return inner(y_, z_); }

    // Axes of W^-1, and the curvature on them of dZ in dY.
    void curve(double barrier, std::array<double, D * D> &axes, Packed<D> &curvature) {
        Packed<D> l;
        factor(y_, l);
        Packed<D> lower = l;  // L itself, whose diagonal the factor holds inverted
        for (int a = 0; a < D; ++a) lower(a, a) = 1.0 / l(a, a);
        invert_factor(l);
        target_ = gram(l);
        for (double &x : target_.a) x *= barrier;
        Packed<D> middle = congruent(z_, lower, true);
        const Spectrum<D> spectrum(middle);
        std::array<double, D> roots{};
        for (int a = 0; a < D; ++a) roots[a] = std::sqrt(std::max(spectrum.roots[a], 0.0));
        scaling_ = congruent(spectrum.with(roots), l, true);
        const Spectrum<D> axes_of(scaling_);
        axes = axes_of.axes;
        for (int a = 0; a < D; ++a)
            for (int b = 0; b <= a; ++b) curvature(a, b) = axes_of.roots[a] * axes_of.roots[b];
        square_ = 0;
        for (double root : axes_of.roots) square_ += root * root;
    }
    // barrier Y^-1, where Z would be.
    const Packed<D> &target() const { return target_; }
    // Z with trace 1: a supergradient of the smallest eigenvalue.
    Packed<D> normal() const {
        Packed<D> out = z_;
        const double sum = z_.trace();
        for (double &x : out.a) x /= sum;
        return out;
    }
    // How far t moves by itself, so that Z + dZ has trace 1.
    double shift() const { return (1.0 - target_.trace()) / square_; }

    // Directions for a change of M, and how far they may be gone.
    void limit(const Packed<D> &change, double &primal, double &dual) {
        const Packed<D> squared = gram_of(scaling_);
        dt_ = shift() + inner(squared, change) / square_;
        dy_ = change;
        for (int a = 0; a < D; ++a) dy_(a, a) -= dt_;
        dz_ = congruent(dy_, scaling_, false);
        for (int q = 0; q < Packed<D>::kSize; ++q) dz_.a[q] = target_.a[q] - z_.a[q] - dz_.a[q];
        primal = std::min(primal, longest(y_, dy_));
        dual = std::min(dual, longest(z_, dz_));
    }
    void move(double primal, double dual) {
        t_ += primal * dt_;
        for (int q = 0; q < Packed<D>::kSize; ++q) {
            y_.a[q] += primal * dy_.a[q];
            z_.a[q] += dual * dz_.a[q];
        }
    }

  private:
    // L' A L for a lower triangle, or S A S for a symmetric matrix.
    static Packed<D> congruent(const Packed<D> &a, const Packed<D> &by, bool lower) {
        const auto at = [&](int i, int j) { return lower ? (i >= j ? by(i, j) : 0.0) : by.both(i, j); };
        Packed<D> out;
        for (int i = 0; i < D; ++i)
            for (int j = 0; j <= i; ++j)
                for (int p = 0; p < D; ++p)
                    for (int q = 0; q < D; ++q) out(i, j) += at(p, i) * a.both(p, q) * at(q, j);
        return out;
    }
    static Packed<D> gram_of(const Packed<D> &s) {
        Packed<D> identity;
        for (int a = 0; a < D; ++a) identity(a, a) = 1.0;
        return congruent(identity, s, false);
    }
    // The largest step for which A + step B is positive semidefinite.
    static double longest(const Packed<D> &a, const Packed<D> &b) {
        Packed<D> l;
        if (!factor(a, l)) return 0.0;
        invert_factor(l);
        Packed<D> relative;  // L^-1 B L^-T
        for (int i = 0; i < D; ++i)
            for (int j = 0; j <= i; ++j)
                for (int p = 0; p <= i; ++p)
                    for (int q = 0; q <= j; ++q) relative(i, j) += l(i, p) * b.both(p, q) * l(j, q);
        const double least = Spectrum<D>(relative).smallest();
        return least < 0 ? -1.0 / least : INFINITY;
    }

    double t_ = 0, dt_ = 0, square_ = 1;
    Packed<D> y_, z_, dy_, dz_, target_, scaling_;
};

}  // namespace trackfield::selection
