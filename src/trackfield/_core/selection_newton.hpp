// One Newton step of the relaxation: a diagonal and a matrix of low rank, by Woodbury's identity.
#pragma once

#include "selection_field.hpp"

namespace trackfield::selection {

// Solve A x = b for symmetric positive definite A (m, m) and several b (m, columns), in place.
inline void solve_in_place(double *a, int m, double *b, int columns) {
    for (int j = 0; j < m; ++j) {
        for (int k = 0; k < j; ++k) a[j * m + j] -= a[j * m + k] * a[j * m + k];
        a[j * m + j] = std::sqrt(a[j * m + j]);
        for (int i = j + 1; i < m; ++i) {
            for (int k = 0; k < j; ++k) a[i * m + j] -= a[i * m + k] * a[j * m + k];
            a[i * m + j] /= a[j * m + j];
        }
    }
    for (int c = 0; c < columns; ++c) {
        for (int i = 0; i < m; ++i) {
            for (int k = 0; k < i; ++k) b[i * columns + c] -= a[i * m + k] * b[k * columns + c];
            b[i * columns + c] /= a[i * m + i];
        }
        for (int i = m - 1; i >= 0; --i) {
            for (int k = i + 1; k < m; ++k) b[i * columns + c] -= a[k * m + i] * b[k * columns + c];
            b[i * columns + c] /= a[i * m + i];
        }
    }
}

template <int D>
class Newton {
  public:
    static constexpr int kRank = Packed<D>::kSize;
    std::array<double, D * D> axes{};
    Packed<D> curve;  // of the merit, on those axes
    std::vector<double> pull, width;  // right side and inverse diagonal; pull becomes the step

    explicit Newton(int n) : pull(n), width(n), features_(size_t(n) * kRank), n_(n) {}

    // A multiple of the identity follows the shares freely: its curvature is taken out.
    void free_shift() {
        square_ = 0;
        for (int a = 0; a < D; ++a) square_ += curve(a, a);
    }

    // Rows of F with F F' the Hessian in the shares.
    template <class Field>
    void expand(const Field &field) {
        Packed<D> root;
        for (int a = 0; a < D; ++a)
            for (int b = 0; b <= a; ++b) root(a, b) = std::sqrt((a == b ? 1.0 : 2.0) * curve(a, b));
        along_.assign(square_ > 0 ? n_ : 0, 0.0);
        for (int i = 0; i < n_; ++i) {
            const double *g = field.gain(i, 0);
            double h[D], *f = features_.data() + size_t(i) * kRank;
            for (int a = 0; a < D; ++a) {
                h[a] = 0;
                for (int j = 0; j < D; ++j) h[a] += axes[j * D + a] * g[j];
                for (int b = 0; b <= a; ++b) f[Packed<D>::at(a, b)] = root(a, b) * h[a] * h[b];
            }
            if (!(square_ > 0)) continue;
            for (int a = 0; a < D; ++a) along_[i] += root(a, a) * f[Packed<D>::at(a, a)];
            for (int a = 0; a < D; ++a) f[Packed<D>::at(a, a)] -= root(a, a) * along_[i] / square_;
        }
    }
    // What the free shift by itself does to a score.
    double lift(int i, double shift) const { return square_ > 0 ? along_[i] * shift : 0.0; }

    // Steps of the shares into pull, and the multipliers of the limits after them.
    template <class Limits>
    void solve(const Limits &limits, const double *slack, const double *multiplier, double barrier, double *next) {
        constexpr int kMost = 3;
        const int columns = 1 + limits.rows;
        double gram[kRank * kRank] = {}, carried[kRank * kMost] = {}, corner[kMost * kMost] = {}, solved[kRank * kMost], schur[4] = {};
        for (int i = 0; i < n_; ++i) {
            const double *f = features_.data() + size_t(i) * kRank;
            double right[kMost] = {pull[i]};
            for (int r = 0; r < limits.rows; ++r) right[r + 1] = limits.used(r, i);
            for (int p = 0; p < kRank; ++p) {
                const double scaled = width[i] * f[p];
                for (int q = 0; q <= p; ++q) gram[p * kRank + q] += scaled * f[q];
                for (int c = 0; c < columns; ++c) carried[p * columns + c] += scaled * right[c];
            }
            for (int c = 0; c < columns; ++c)
                for (int e = 0; e < columns; ++e) corner[c * columns + e] += width[i] * right[c] * right[e];
        }
        for (int p = 0; p < kRank; ++p) gram[p * kRank + p] += 1.0;
        std::copy(carried, carried + kRank * columns, solved);
        solve_in_place(gram, kRank, solved, columns);
        for (int c = 0; c < columns; ++c)
            for (int e = 0; e < columns; ++e)
                for (int p = 0; p < kRank; ++p) corner[c * columns + e] -= carried[p * columns + c] * solved[p * columns + e];
        for (int r = 0; r < limits.rows; ++r) {
            for (int t = 0; t < limits.rows; ++t) schur[r * limits.rows + t] = corner[(r + 1) * columns + t + 1];
            schur[r * limits.rows + r] += slack[r] / multiplier[r];
            next[r] = corner[(r + 1) * columns] + barrier / multiplier[r];
        }
        solve_in_place(schur, limits.rows, next, 1);
        double lean[kRank];
        for (int p = 0; p < kRank; ++p) {
            lean[p] = solved[p * columns];
            for (int r = 0; r < limits.rows; ++r) lean[p] -= solved[p * columns + r + 1] * next[r];
        }
        for (int i = 0; i < n_; ++i) {
            const double *f = features_.data() + size_t(i) * kRank;
            double right = pull[i];
            for (int r = 0; r < limits.rows; ++r) right -= next[r] * limits.used(r, i);
            for (int p = 0; p < kRank; ++p) right -= f[p] * lean[p];
            pull[i] = width[i] * right;
        }
    }

  private:
    std::vector<double> features_, along_;
    int n_;
    double square_ = 0;
};

}  // namespace trackfield::selection
