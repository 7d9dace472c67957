// The iterated update of one belief, linearized where the readings put the target; information form.
#pragma once

#include <algorithm>
#include <vector>

#include "angle_evidence.hpp"

namespace trackfield::angles {

struct Belief {
    double m[kMost];
    double P[kMost * kMost];
};

struct Rules {
    int steps, halvings;
    double tolerance;
    std::vector<double> shares, spreads;  // kinds of readings: the first is the usual one
};

struct Row {
    double z, base, variance, trust, h;
    double H[kMost];
    bool heard;
};

struct Outcome {
    Belief posterior;
    double log_likelihood;
};

// X = (I + P M)^-1 P, made symmetric; returns log det (I + P M). Gauss with pivots.
inline double conditioned(const double *P, const double *M, int n, double *X) {
    double A[kMost][2 * kMost];
    for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) {
            double sum = i == j;
            for (int k = 0; k < n; ++k) sum += P[n * i + k] * M[n * k + j];
            A[i][j] = sum;
            A[i][n + j] = P[n * i + j];
        }
    double log_det = 0;
    for (int c = 0; c < n; ++c) {
        int pivot = c;
        for (int i = c + 1; i < n; ++i)
            if (std::fabs(A[i][c]) > std::fabs(A[pivot][c])) pivot = i;
        if (pivot != c)
            for (int j = c; j < 2 * n; ++j) std::swap(A[c][j], A[pivot][j]);
        log_det += std::log(std::fabs(A[c][c]));
        for (int i = 0; i < n; ++i) {
            if (i == c) continue;
            const double f = A[i][c] / A[c][c];
            if (f == 0) continue;
            for (int j = c; j < 2 * n; ++j) A[i][j] -= f * A[c][j];
        }
    }
    for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j)
            X[n * i + j] = 0.5 * (A[i][n + j] / A[i][i] + A[j][n + i] / A[j][j]);
    return log_det;
}

inline double form(const double *h, const double *P, int n) {
    double sum = 0;
    for (int i = 0; i < n; ++i) {
        double row = 0;
        for (int j = 0; j < n; ++j) row += P[n * i + j] * h[j];
        sum += h[i] * row;
    }
    return sum;
}

class Update {
  public:
    Update(const std::vector<Look> &looks, const Rules &rules, int d) : looks_(looks), rules_(rules), d_(d), n_(2 * d) {
        rows_.resize(looks.size());
    }

    // Plain readings for the prior: silence by what it expects, signs by what it does together with
    // the readings that have one. After a sharp turn the prior alone would take the wrong ones, and so
    // believe itself.
    void prepare(const Belief &prior, double *chances) {
        silent_log_ = 0;
        const Belief signs = after_signed(prior);
        for (size_t i = 0; i < looks_.size(); ++i) {
            const Look &look = looks_[i];
            Row &row = rows_[i];
            row.h = expected(look, prior.m, d_, row.H);
            const double R = look.sigma * look.sigma, S = form(row.H, prior.P, n_) + R;
            row.heard = !look.silent();
            Evidence evidence{look.value, R};
            if (!row.heard)
                evidence = silence(look, prior.m, row.h, S, R);
            else if (unsigned_in_plane(look, prior.m, d_)) {
                double H[kMost];
                const double h = expected(look, signs.m, d_, H);
                evidence = of_size(look.value, h, form(H, signs.P, n_) + R, R);
            }
            row.z = evidence.z;
            row.base = row.variance = evidence.R;
            row.trust = 1.0;
            if (chances) chances[i] = evidence.chance;
            if (!row.heard) silent_log_ += std::log(std::max(look.alive * evidence.chance + 1.0 - look.alive, 1e-300));
        }
    }

    Outcome run(const Belief &prior) {
        double x[kMost], y[kMost] = {};
        std::copy(prior.m, prior.m + n_, x);
        double moved = 1e300;
        for (int turn = 0; turn < 2; ++turn) {
            if (turn == 1) judge(prior, x);
            const double enough = turn == 1 ? rules_.tolerance : std::sqrt(rules_.tolerance);
            moved = 1e300;
            for (int step = 0; step < rules_.steps && moved > enough; ++step) moved = descend(prior, x, y);
        }
        Outcome out;
        look_at(x);
        bool all = true;
        for (const Row &row : rows_) all = all && row.heard;
        out.log_likelihood = linearized(prior, x, out.posterior, true);
        if (!all) {
            Belief unused;
            out.log_likelihood = linearized(prior, x, unused, false);
        }
        out.log_likelihood += silent_log_ - doubt();
        return out;
    }

    // Squared innovation of the readings that were heard, in one step from the prior, per reading.
    double nis(const Belief &prior) {
        Belief unused;
        int heard = 0;
        for (Row &row : rows_) heard += row.heard;
        if (!heard) return std::nan("");
        distance2_ = 0;
        linearized(prior, prior.m, unused, false);
        return distance2_ / heard;
    }

  private:
    // The prior after the readings that were heard with a sign, where there are others without.
    Belief after_signed(const Belief &prior) const {
        std::vector<Look> with, without;
        for (const Look &look : looks_)
            if (!look.silent()) (unsigned_in_plane(look, prior.m, d_) ? without : with).push_back(look);
        if (with.empty() || without.empty()) return prior;
        Update signed_only(with, rules_, d_);
        signed_only.prepare(prior, nullptr);
        return signed_only.run(prior).posterior;
    }

    Evidence silence(const Look &look, const double *m, double mean, double S, double R) const {
        const Offset o = offset_of(look, m, d_);
        const double r = std::sqrt(o.x[0] * o.x[0] + o.x[1] * o.x[1] + o.x[2] * o.x[2]);
        if (r > look.reach) return {mean, std::numeric_limits<double>::infinity()};
        const bool one_sided = look.says == kMotion && !o.plane;
        const double least = one_sided ? -std::numeric_limits<double>::infinity() : -look.threshold;
        return of_silence(least, look.threshold, mean, S, R, look.alive);
    }

    void look_at(const double *x) {
        for (size_t i = 0; i < looks_.size(); ++i) rows_[i].h = expected(looks_[i], x, d_, rows_[i].H);
    }

    // M = H' W H of the rows, silent ones only if asked for.
    void information(double *M, bool silent) const {
        std::fill(M, M + n_ * n_, 0.0);
        for (const Row &row : rows_) {
            if (!(row.heard || silent)) continue;
            for (int i = 0; i < n_; ++i) {
                const double g = row.H[i] / row.variance;
                for (int j = 0; j < n_; ++j) M[n_ * i + j] += g * row.H[j];
            }
        }
    }

    double innovation(const Row &row, const Belief &prior, const double *x) const {
        double e = row.z - row.h;
        for (int k = 0; k < n_; ++k) e -= row.H[k] * (prior.m[k] - x[k]);
        return e;
    }

    // Shift of the prior's mean and the covariance after the rows, linearized at x.
    double shifted(const Belief &prior, const double *x, double *shift, double *covariance, bool silent) const {
        double M[kMost * kMost], pull[kMost] = {};
        information(M, silent);
        const double log_det = conditioned(prior.P, M, n_, covariance);
        for (const Row &row : rows_) {
            if (!(row.heard || silent)) continue;
            const double e = innovation(row, prior, x) / row.variance;
            for (int k = 0; k < n_; ++k) pull[k] += row.H[k] * e;
        }
        for (int i = 0; i < n_; ++i) {
            shift[i] = 0;
            for (int j = 0; j < n_; ++j) shift[i] += covariance[n_ * i + j] * pull[j];
        }
        return log_det;
    }

    double linearized(const Belief &prior, const double *x, Belief &posterior, bool silent) {
        double shift[kMost];
        double log_det = shifted(prior, x, shift, posterior.P, silent), d2 = 0;
        int count = 0;
        for (const Row &row : rows_) {
            if (!row.heard) continue;
            const double e = innovation(row, prior, x);
            double left = e;
            for (int k = 0; k < n_; ++k) left -= row.H[k] * shift[k];
            d2 += e * left / row.variance;
            log_det += std::log(row.variance);
            ++count;
        }
        for (int k = 0; k < n_; ++k) posterior.m[k] = prior.m[k] + shift[k];
        distance2_ = d2;
        return -0.5 * (d2 + log_det + count * std::log(kTurn));
    }

    double cost(const Belief &prior, const double *x, const double *y) {
        double sum = 0, unused[kMost];
        for (int k = 0; k < n_; ++k) sum += (x[k] - prior.m[k]) * y[k];
        for (size_t i = 0; i < rows_.size(); ++i) {
            const double e = rows_[i].z - expected(looks_[i], x, d_, unused);
            sum += e * e / rows_[i].variance;
        }
        return sum;
    }

    // One Gauss-Newton step, halved until it descends; y = P^-1 (x - mean). Its greatest move in sigmas.
    double descend(const Belief &prior, double *x, double *y) {
        double shift[kMost], covariance[kMost * kMost], to_x[kMost], to_y[kMost] = {};
        look_at(x);
        shifted(prior, x, shift, covariance, true);
        for (const Row &row : rows_) {
            double left = innovation(row, prior, x);
            for (int k = 0; k < n_; ++k) left -= row.H[k] * shift[k];
            for (int k = 0; k < n_; ++k) to_y[k] += row.H[k] * left / row.variance;
        }
        for (int k = 0; k < n_; ++k) to_x[k] = prior.m[k] + shift[k] - x[k], to_y[k] -= y[k];
        const double before = cost(prior, x, y);
        double length = 1.0, new_x[kMost], new_y[kMost];
        for (int halving = 0;; ++halving) {
            for (int k = 0; k < n_; ++k) new_x[k] = x[k] + length * to_x[k], new_y[k] = y[k] + length * to_y[k];
            if (halving == rules_.halvings || cost(prior, new_x, new_y) <= before + 1e-9 * (1.0 + before)) break;
            length *= 0.5;
        }
        double moved = 0;
        for (int k = 0; k < n_; ++k) {
            const double sigma = std::sqrt(std::max(covariance[(n_ + 1) * k], 0.0));
            moved = std::max(moved, length * std::fabs(to_x[k]) / std::max(sigma, 1e-300));
            x[k] = new_x[k];
            y[k] = new_y[k];
        }
        return moved;
    }

    // The noise that a fitted state suggests, each reading judged by all others and the prior.
    void judge(const Belief &prior, const double *x) {
        double shift[kMost], covariance[kMost * kMost];
        look_at(x);
        shifted(prior, x, shift, covariance, true);
        for (Row &row : rows_) {
            if (!row.heard) continue;
            const double shadow = form(row.H, covariance, n_), share = shadow / row.variance;
            const double free = std::max(1.0 - share, 1e-6), e = row.z - row.h;
            const double residual = e + share / free * e, others = shadow / free;
            weigh(row, residual, others + row.base);
        }
    }

    // The mean precision of usual readings and wider ones (EM): unlike the mean variance it is hardly less
    // than the usual one for a reading that fits.
    void weigh(Row &row, double residual, double spread) const {
        double top = -1e300, total = 0, precision = 0, first = 0;
        double log_p[8];
        for (size_t j = 0; j < rules_.shares.size(); ++j) {
            const double S = spread + rules_.spreads[j] * rules_.spreads[j] * row.base;
            log_p[j] = std::log(rules_.shares[j]) - 0.5 * (residual * residual / S + std::log(S));
            top = std::max(top, log_p[j]);
        }
        for (size_t j = 0; j < rules_.shares.size(); ++j) {
            const double p = std::exp(log_p[j] - top);
            total += p;
            precision += p / (1.0 + rules_.spreads[j] * rules_.spreads[j]);
            if (j == 0) first = p;
        }
        row.variance = row.base * total / precision;
        row.trust = first / total;
    }

    // Divergence of what the readings are taken for from what is usual.
    double doubt() const {
        const double usual = rules_.shares[0];
        double sum = 0;
        for (const Row &row : rows_) {
            if (!row.heard) continue;
            const double t = std::clamp(row.trust, 1e-12, 1.0 - 1e-12);
            sum += t * std::log(t / usual) + (1.0 - t) * std::log((1.0 - t) / (1.0 - usual));
        }
        return sum;
    }

    const std::vector<Look> &looks_;
    const Rules &rules_;
    const int d_, n_;
    std::vector<Row> rows_;
    double silent_log_ = 0, distance2_ = 0;
};

}  // namespace trackfield::angles
