// Small symmetric matrices, lower triangles row by row: what a set of sensors knows.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

namespace trackfield::selection {

constexpr double kNothing = -1e300;  // merit of a matrix that is not positive definite

template <int D>
struct Packed {
    static constexpr int kSize = D * (D + 1) / 2;
    std::array<double, kSize> a{};

    static constexpr int at(int i, int j) { return i * (i + 1) / 2 + j; }  // i >= j
    double &operator()(int i, int j) { return a[at(i, j)]; }
    double operator()(int i, int j) const { return a[at(i, j)]; }
    double both(int i, int j) const { return i >= j ? a[at(i, j)] : a[at(j, i)]; }

    void add(const Packed &other) {
        for (int q = 0; q < kSize; ++q) a[q] += other.a[q];
    }
    void add_outer(const double *g, double weight = 1.0) {
        for (int i = 0; i < D; ++i)
            for (int j = 0; j <= i; ++j) a[at(i, j)] += weight * g[i] * g[j];
    }
    double trace() const {
        double sum = 0;
        for (int i = 0; i < D; ++i) sum += a[at(i, i)];
        return sum;
    }
    double quadratic(const double *g) const {
        double sum = 0;
        for (int i = 0; i < D; ++i) {
            sum += a[at(i, i)] * g[i] * g[i];
            for (int j = 0; j < i; ++j) sum += 2.0 * a[at(i, j)] * g[i] * g[j];
        }
        return sum;
    }
};

template <int D>
Packed<D> sum(Packed<D> one, const Packed<D> &other) {
    one.add(other);
    return one;
}

// tr A B.
template <int D>
double inner(const Packed<D> &one, const Packed<D> &other) {
    double sum = 0;
    for (int i = 0; i < D; ++i)
        for (int j = 0; j <= i; ++j) sum += (i == j ? 1.0 : 2.0) * one(i, j) * other(i, j);
    return sum;
}

// Lower triangle L of M = L L', its diagonal inverted; false where M is not positive definite.
template <int D>
bool factor(const Packed<D> &m, Packed<D> &l) {
    for (int j = 0; j < D; ++j) {
        double pivot = m(j, j);
        for (int k = 0; k < j; ++k) pivot -= l(j, k) * l(j, k);
        if (!(pivot > 0.0)) return false;
        const double inverse = 1.0 / std::sqrt(pivot);
        l(j, j) = inverse;
        for (int i = j + 1; i < D; ++i) {
            double rest = m(i, j);
            for (int k = 0; k < j; ++k) rest -= l(i, k) * l(j, k);
            l(i, j) = rest * inverse;
        }
    }
    return true;
}

// Turn a factor into L^-1, in place.
template <int D>
void invert_factor(Packed<D> &l) {
    for (int i = 1; i < D; ++i)
        for (int j = 0; j < i; ++j) {
            double rest = 0;
            for (int k = j; k < i; ++k) rest += l(i, k) * l(k, j);
            l(i, j) = -l(i, i) * rest;
        }
}

// Inverse of M from L^-1.
template <int D>
Packed<D> gram(const Packed<D> &l) {
    Packed<D> out;
    for (int i = 0; i < D; ++i)
        for (int j = 0; j <= i; ++j)
            for (int k = i; k < D; ++k) out(i, j) += l(k, i) * l(k, j);
    return out;
}

// Eigenvalues, and eigenvectors as columns of axes (D x D, row by row): Jacobi's rotations.
template <int D>
struct Spectrum {
    std::array<double, D> roots{};
    std::array<double, D * D> axes{};

    explicit Spectrum(Packed<D> m) {
        for (int i = 0; i < D; ++i) axes[i * D + i] = 1.0;
        for (int sweep = 0; sweep < 30 && rotate(m); ++sweep) {}
        for (int i = 0; i < D; ++i) roots[i] = m(i, i);
    }
    double smallest() const { return *std::min_element(roots.begin(), roots.end()); }
    double largest() const { return *std::max_element(roots.begin(), roots.end()); }
    // The matrix that has these roots on the same axes.
    Packed<D> with(const std::array<double, D> &others) const {
        Packed<D> out;
        for (int i = 0; i < D; ++i)
            for (int j = 0; j <= i; ++j)
                for (int a = 0; a < D; ++a) out(i, j) += others[a] * axes[i * D + a] * axes[j * D + a];
        return out;
    }

  private:
    bool rotate(Packed<D> &m) {
        bool moved = false;
        for (int p = 1; p < D; ++p)
            for (int q = 0; q < p; ++q) {
                const double off = m(p, q);
                if (std::abs(off) <= 1e-17 * (std::abs(m(p, p)) + std::abs(m(q, q)))) continue;
                moved = true;
                const double theta = (m(q, q) - m(p, p)) / (2.0 * off);
                const double t = std::copysign(1.0, theta) / (std::abs(theta) + std::sqrt(theta * theta + 1.0));
                const double c = 1.0 / std::sqrt(t * t + 1.0), s = t * c;
                m(p, p) -= t * off;
                m(q, q) += t * off;
                m(p, q) = 0.0;
                for (int k = 0; k < D; ++k) {
                    if (k != p && k != q) {
                        double &kp = m.a[k > p ? Packed<D>::at(k, p) : Packed<D>::at(p, k)];
                        double &kq = m.a[k > q ? Packed<D>::at(k, q) : Packed<D>::at(q, k)];
                        const double old = kp;
                        kp = c * old - s * kq;
                        kq = s * old + c * kq;
                    }
                    double &vp = axes[k * D + p], &vq = axes[k * D + q];
                    const double old = vp;
                    vp = c * old - s * vq;
                    vq = s * old + c * vq;
                }
            }
        return moved;
    }
};

}  // namespace trackfield::selection
