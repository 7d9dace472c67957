// Shares of sensors instead of sensors: the concave problem that bounds every selection from above.
#pragma once

#include "selection_cut.hpp"
#include "selection_newton.hpp"
#include "selection_semidefinite.hpp"

namespace trackfield::selection {

// Maximise the merit of P + sum w_i g_i g_i' over 0 <= w <= 1 within limits: a primal-dual
// interior-point method. A Newton step costs O(n D^4), since the Hessian has rank D (D + 1) / 2.
template <int D>
class Relaxation {
  public:
    std::vector<double> share;
    double value = kNothing;
    Cut<D> cut;
    int steps = 0;

    Relaxation(const Field<D> &field, const Limits &limits, double ridge)
        : share(field.n), field_(field), n_(field.n), limits_(limits), prior_(field.start(ridge)[0]), high_(n_), low_(n_), newton_(n_) {}

    // Until the bound is within that share, or rounding stops the steps; it holds in any case.
    void solve(double tolerance) {
        begin();
        std::vector<double> last = share;
        double best = value;
        for (steps = 0; steps < kSteps; ++steps) {
            weigh();
            if (!std::isfinite(gap_) || !std::isfinite(value)) break;
            last = share;
            best = value;
            const double size = scale();
            if (gap_ <= kNear * size) judge();
            if (cut.bound - value <= tolerance * size || gap_ <= kExact * size || (stalled_ && gap_ <= kNear * size)) return;
            step();
        }
        share = last;
        value = best;
        if (std::isfinite(gap_)) judge();
    }
    // Of merits: what a share of them means. Logarithms are what they are.
    double scale() const { return field_.criterion == Criterion::kDeterminant ? double(D) : std::abs(value); }

  private:
    static constexpr int kSteps = 80;
    static constexpr double kBoundary = 0.97, kNear = 0.1, kExact = 1e-9, kStall = 1e-3;

    bool of_roots() const { return field_.criterion == Criterion::kSmallestRoot; }

    void begin() {
        double start = std::min(0.5, 0.9 * limits_.most[0] / n_);
        if (limits_.rows == 2) {
            const double all = std::accumulate(limits_.costs, limits_.costs + n_, 0.0);
            if (all > 0) start = std::min(start, 0.9 * limits_.most[1] / all);
        }
        std::fill(share.begin(), share.end(), start);
        inform();
        if (of_roots()) {
            roots_.begin(information_);
            barrier_ = roots_.gap() / D;
        }
        curve();
        double mean = 0;
        for (int i = 0; i < n_; ++i) mean += slope_.quadratic(field_.gain(i, 0)) / n_;
        barrier_ = std::max(mean * start, 1e-300);
        for (int i = 0; i < n_; ++i) low_[i] = barrier_ / start, high_[i] = barrier_ / (1.0 - start);
        for (int r = 0; r < limits_.rows; ++r) {
            slack_[r] = limits_.most[r];
            for (int i = 0; i < n_; ++i) slack_[r] -= limits_.used(r, i) * start;
            multiplier_[r] = barrier_ / slack_[r];
        }
    }

    void inform() {
        information_ = prior_;
        for (int i = 0; i < n_; ++i)
            for (int q = 0; q < Packed<D>::kSize; ++q) information_.a[q] += share[i] * field_.outer[i].a[q];
        value = merit(information_, field_.criterion);
    }

    // Gradient of the merit, and its curvature on the axes on which that is a sum of squares.
    void curve() {
        if (of_roots()) {
            roots_.curve(barrier_, newton_.axes, newton_.curve);
            slope_ = roots_.target();
            return;
        }
        const Spectrum<D> spectrum(information_);
        newton_.axes = spectrum.axes;
        std::array<double, D> slope{};
        const auto &l = spectrum.roots;
        const bool trace = field_.criterion == Criterion::kTrace;
        for (int a = 0; a < D; ++a) {
            slope[a] = trace ? 1.0 / (l[a] * l[a]) : 1.0 / l[a];
            for (int b = 0; b <= a; ++b) newton_.curve(a, b) = (trace ? 1.0 / l[a] + 1.0 / l[b] : 1.0) / (l[a] * l[b]);
        }
        slope_ = spectrum.with(slope);
    }

    // How far the products of bounds and multipliers are from zero, where they should be next, and
    // what the merit does about the present shares.
    void weigh() {
        inform();
        gap_ = of_roots() ? roots_.gap() : 0.0;
        for (int i = 0; i < n_; ++i) gap_ += share[i] * low_[i] + (1.0 - share[i]) * high_[i];
        for (int r = 0; r < limits_.rows; ++r) gap_ += slack_[r] * multiplier_[r];
        barrier_ = shrink_ * gap_ / (2 * n_ + limits_.rows + (of_roots() ? D : 0));
        curve();
    }

    // Tangent with the present gradient, if it is lower than what was found before.
    void judge() {
        const Packed<D> slope = of_roots() ? roots_.normal() : slope_;
        const Cut<D> found = tangent(slope, field_, limits_, prior_, limits_.rows == 2 ? multiplier_[1] : 0.0);
        if (found.bound < cut.bound) cut = found;
    }

    void step() {
        double shift = 0;
        if (of_roots()) newton_.free_shift(), shift = roots_.shift();
        newton_.expand(field_);
        double next[2];
        for (int i = 0; i < n_; ++i) {
            const double w = share[i];
            newton_.pull[i] = slope_.quadratic(field_.gain(i, 0)) + barrier_ / w - barrier_ / (1.0 - w) + newton_.lift(i, shift);
            newton_.width[i] = 1.0 / (low_[i] / w + high_[i] / (1.0 - w));
        }
        newton_.solve(limits_, slack_, multiplier_, barrier_, next);
        move(next);
    }

    void move(const double *next) {
        double primal = 1.0 / kBoundary, dual = 1.0 / kBoundary, used[2] = {0, 0};
        Packed<D> change;
        for (int i = 0; i < n_; ++i) {
            const double dw = newton_.pull[i], w = share[i];
            for (int r = 0; r < limits_.rows; ++r) used[r] += limits_.used(r, i) * dw;
            if (dw < 0) primal = std::min(primal, -w / dw);
            if (dw > 0) primal = std::min(primal, (1.0 - w) / dw);
            const double dz = (barrier_ - low_[i] * dw) / w - low_[i], dy = (barrier_ + high_[i] * dw) / (1.0 - w) - high_[i];
            if (dz < 0) dual = std::min(dual, -low_[i] / dz);
            if (dy < 0) dual = std::min(dual, -high_[i] / dy);
        }
        for (int r = 0; r < limits_.rows; ++r) {
            if (used[r] > 0) primal = std::min(primal, slack_[r] / used[r]);
            if (next[r] < multiplier_[r]) dual = std::min(dual, multiplier_[r] / (multiplier_[r] - next[r]));
        }
        if (of_roots()) {
            for (int i = 0; i < n_; ++i) change.add_outer(field_.gain(i, 0), newton_.pull[i]);
            roots_.limit(change, primal, dual);
        }
        primal *= kBoundary;
        dual *= kBoundary;
        for (int i = 0; i < n_; ++i) {
            const double dw = newton_.pull[i], w = share[i];
            low_[i] += dual * ((barrier_ - low_[i] * dw) / w - low_[i]);
            high_[i] += dual * ((barrier_ + high_[i] * dw) / (1.0 - w) - high_[i]);
            share[i] += primal * dw;
        }
        for (int r = 0; r < limits_.rows; ++r) {
            slack_[r] -= primal * used[r];
            multiplier_[r] += dual * (next[r] - multiplier_[r]);
        }
        if (of_roots()) roots_.move(primal, dual);
        const double rest = 1.0 - std::min(primal, dual);
        shrink_ = std::clamp(rest * rest, 0.02, 0.3);
        stalled_ = std::max(primal, dual) < kStall;
    }

    const Field<D> &field_;
    int n_;
    Limits limits_;
    Packed<D> prior_, information_, slope_;
    double slack_[2] = {0, 0}, multiplier_[2] = {0, 0}, barrier_ = 0, gap_ = 0, shrink_ = 0.1;
    bool stalled_ = false;
    std::vector<double> high_, low_;
    Newton<D> newton_;
    Semidefinite<D> roots_;
};

}  // namespace trackfield::selection
