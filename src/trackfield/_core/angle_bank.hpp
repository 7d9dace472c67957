// Ways of moving side by side (IMM): mixed, moved straight on with white acceleration, conditioned.
#pragma once

#include "angle_update.hpp"

namespace trackfield::angles {

class Bank {
  public:
    Bank(int n, size_t modes, const double *shares, const double *mean, const double *covariance)
        : n_(n), shares_(shares, shares + modes), beliefs_(modes) {
        for (size_t j = 0; j < modes; ++j) {
            std::copy(mean + j * n, mean + (j + 1) * n, beliefs_[j].m);
            std::copy(covariance + j * n * n, covariance + (j + 1) * n * n, beliefs_[j].P);
        }
    }

    // Motions (M, 2): density of the acceleration and mean stay [s].
    void predict(double dt, const double *motions) {
        const size_t modes = shares_.size();
        std::vector<double> shares(modes);
        std::vector<Belief> mixed(modes);
        for (size_t j = 0; j < modes; ++j) {
            std::vector<double> weight(modes);
            for (size_t i = 0; i < modes; ++i) {
                const double stay = modes == 1 ? 1.0 : std::exp(-dt / motions[2 * i + 1]);
                weight[i] = shares_[i] * (i == j ? stay : (1.0 - stay) / double(modes - 1));
                shares[j] += weight[i];
            }
            mixed[j] = moments(weight, shares[j]);
            move(mixed[j], dt, motions[2 * j]);
        }
        shares_ = shares;
        beliefs_ = mixed;
    }

    // Returns the log likelihood of the whole; `nis` is that of the moments, `chances` (m,) of silence too.
    double update(const std::vector<Look> &looks, const Rules &rules, double *nis, double *chances) {
        Update update(looks, rules, n_ / 2);
        const Belief whole = combined();
        update.prepare(whole, chances);
        *nis = update.nis(whole);
        std::vector<double> log_weight(shares_.size());
        double top = -1e300, total = 0;
        for (size_t j = 0; j < shares_.size(); ++j) {
            update.prepare(beliefs_[j], nullptr);
            const Outcome outcome = update.run(beliefs_[j]);
            beliefs_[j] = outcome.posterior;
            log_weight[j] = std::log(std::max(shares_[j], 1e-300)) + outcome.log_likelihood;
            top = std::max(top, log_weight[j]);
        }
        for (size_t j = 0; j < shares_.size(); ++j) total += shares_[j] = std::exp(log_weight[j] - top);
        for (double &share : shares_) share /= total;
        return top + std::log(total);
    }

    Belief combined() const { return moments(shares_, 1.0); }
    const std::vector<double> &shares() const { return shares_; }
    const std::vector<Belief> &beliefs() const { return beliefs_; }

  private:
    Belief moments(const std::vector<double> &weight, double total) const {
        Belief out = {};
        total = std::max(total, 1e-300);
        for (size_t i = 0; i < weight.size(); ++i)
            for (int a = 0; a < n_; ++a) out.m[a] += weight[i] / total * beliefs_[i].m[a];
        for (size_t i = 0; i < weight.size(); ++i)
            for (int a = 0; a < n_; ++a)
                for (int b = 0; b < n_; ++b)
                    out.P[n_ * a + b] += weight[i] / total *
                                         (beliefs_[i].P[n_ * a + b] +
                                          (beliefs_[i].m[a] - out.m[a]) * (beliefs_[i].m[b] - out.m[b]));
        return out;
    }

    void move(Belief &belief, double dt, double density) const {
        const int d = n_ / 2;
        double *P = belief.P;
        for (int k = 0; k < d; ++k) belief.m[k] += dt * belief.m[d + k];
        for (int a = 0; a < d; ++a)  // rows, then columns, of F P F'
            for (int b = 0; b < n_; ++b) P[n_ * a + b] += dt * P[n_ * (d + a) + b];
        for (int a = 0; a < n_; ++a)
            for (int b = 0; b < d; ++b) P[n_ * a + b] += dt * P[n_ * a + d + b];
        for (int k = 0; k < d; ++k) {
            P[n_ * k + k] += density * dt * dt * dt / 3.0;
            P[n_ * k + d + k] += density * dt * dt / 2.0;
            P[n_ * (d + k) + k] += density * dt * dt / 2.0;
            P[n_ * (d + k) + d + k] += density * dt;
        }
    }

    int n_;
    std::vector<double> shares_;
    std::vector<Belief> beliefs_;
};

// What a step returns, as tables.
struct Tables {
    Tables(size_t hypotheses, size_t modes, size_t n, size_t readings)
        : n(n), modes(modes), shares(hypotheses * modes), mean(hypotheses * modes * n),
          covariance(hypotheses * modes * n * n), prior_mean(hypotheses * n), prior_covariance(hypotheses * n * n),
          whole_mean(hypotheses * n), whole_covariance(hypotheses * n * n), log_likelihood(hypotheses),
          nis(hypotheses), chance(hypotheses * readings) {}

    void put_prior(size_t h, const Belief &belief) {
        std::copy(belief.m, belief.m + n, prior_mean.begin() + h * n);
        std::copy(belief.P, belief.P + n * n, prior_covariance.begin() + h * n * n);
    }

    void put(size_t h, const Bank &bank) {
        const Belief belief = bank.combined();
        std::copy(belief.m, belief.m + n, whole_mean.begin() + h * n);
        std::copy(belief.P, belief.P + n * n, whole_covariance.begin() + h * n * n);
        std::copy(bank.shares().begin(), bank.shares().end(), shares.begin() + h * modes);
        for (size_t j = 0; j < modes; ++j) {
            const Belief &one = bank.beliefs()[j];
            std::copy(one.m, one.m + n, mean.begin() + (h * modes + j) * n);
            std::copy(one.P, one.P + n * n, covariance.begin() + (h * modes + j) * n * n);
        }
    }

    size_t n, modes;
    std::vector<double> shares, mean, covariance, prior_mean, prior_covariance, whole_mean, whole_covariance,
        log_likelihood, nis, chance;
};

}  // namespace trackfield::angles
