// Joint maximum-likelihood fit of a few sources to the sensors about them: damped Gauss-Newton, whose
// weights follow the fit, and which turns robust where a reading stays far off.
#pragma once

#include "signal_field.hpp"

namespace trackfield::signals {

constexpr int kIterations = 30;
constexpr int kTrialIterations = 10;  // of a start that is one of several
constexpr double kFew = 0.5;         // share of outliers that may be let go in a first fit
constexpr int kSoftIterations = 4;   // with Huber's weights, before outliers are let go
constexpr int kSoftStart = 12;       // the same where the fit begins with them
constexpr double kDone = 1e-6;       // promised gain [nats] at which a fit ends
constexpr double kFactorStep = 0.5;

struct Settings {
    double leader_sigmas = 0;  // excess of a sensor that may lead
    double leader_radius = 0, fit_radius = 0, group_radius = 0, max_step = 0;  // [m]
    double gain = 0;            // in log-likelihood, that a source must bring [nats]
    double split_gain = 0;      // the same of two in place of one
    double outlier_sigmas = 0;  // a reading further off is taken for broken
    int group = 0, rounds = 0;
    int64_t work = 0;  // pairs of sensor and source that a scan may cost
};

struct Fit {
    std::vector<Source> sources;
    std::vector<double> covariance;  // xx, xy, yy of each source
    double start = 0;                // objective where the fit began
    double objective = 0;            // log-likelihood with outliers, and priors, but for a constant
    double chi2 = 0;
    size_t n = 0;
    bool good() const { return chi2 <= double(n) + 4.0 * std::sqrt(2.0 * double(n)); }
};

enum class Trust { all = 0, soft = 1, settled = 2 };

class Fitter {
   public:
    std::vector<int32_t> sensors;     // the window
    std::vector<Signal> background;   // of sources that stay as they are

    Fitter(const Field &field, const Settings &settings, int64_t &spent) : f(field), s(settings), spent(spent) {
        d = f.factor_sigma > 0 ? 3 : 2;
    }

    Fit judge(const std::vector<Source> &sources) {
        Fit o;
        evaluate(sources, now);
        finish(sources, now, o);
        return o;
    }

    // From a first guess all readings count, and those far off are let go only if they are few: else
    // they may be of sources that are not known yet. A soft fit never follows any reading far; one that
    // is settled lets go of what is far off where it begins.
    Fit run(const std::vector<Source> &start, Trust trust, int iterations = kIterations) {
        Fit o;
        std::vector<Source> at = start;
        evaluate(at, now);
        finish(at, now, o);
        o.start = o.objective;
        phase = int(trust);
        weigh(now);
        normal(at, now);
        double damping = 0;
        int soft = 0;
        for (int k = 0; k < iterations && spent < s.work; ++k) {
            const bool solved = solve(damping);
            const bool ended = solved && promised < kDone && damping < 1.0;
            if (ended || (phase == 1 && soft >= (trust == Trust::soft ? kSoftStart : kSoftIterations))) {
                if (phase == 2 || (phase == 0 && !few_are_off())) break;
                ++phase;
                soft = 0, damping = 0;
                weigh(now);
                normal(at, now);
                continue;
            }
            if (phase == 1) ++soft;
            std::vector<Source> trial = at;
            if (solved) move(trial);
            evaluate(trial, then);
            if (solved && cost(trial, then) <= cost(at, now) * (1 + 1e-12)) {
                at.swap(trial);
                std::swap(now, then);
                weigh(now);
                normal(at, now);
                damping = damping > 1e-4 ? 0.1 * damping : 0.0;
            } else {
                damping = std::max(4.0 * damping, 1e-2);
            }
        }
        finish(at, now, o);
        normal(at, now);
        covariances(at.size(), o);
        return o;
    }

   private:
    struct Terms {
        std::vector<double> r, v, J;  // residual, variance, slopes (n, sources, d)
    };

    double prior_place(const Source &c) const {
        const double reach = f.range[c.leader];
        return std::isfinite(reach) ? 1.0 / (reach * reach) : 0.0;
    }
    double prior_factor() const { return d == 3 ? 1.0 / (f.factor_sigma * f.factor_sigma) : 0.0; }

    void evaluate(const std::vector<Source> &at, Terms &t) {
        const size_t n = sensors.size(), K = at.size();
        t.r.resize(n), t.v.resize(n), t.J.assign(n * K * d, 0.0);
        spent += int64_t(n * K) + 1;
        for (size_t j = 0; j < n; ++j) {
            const size_t i = size_t(sensors[j]);
            Signal sum = background[j];
            double *J = t.J.data() + j * K * d;
            for (size_t k = 0; k < K; ++k) {
                const Signal one = signal_of(f, i, at[k]);
                if (f.strongest_only && one.h > sum.h) std::fill(J, J + K * d, 0.0);
                if (!f.strongest_only || one.h > sum.h) {
                    J[k * d] = one.gx;
                    J[k * d + 1] = one.gy;
                    if (d == 3) J[k * d + 2] = one.h;
                }
                add(f, sum, one);
            }
            t.r[j] = residual_of(f, i, sum);
            t.v[j] = variance_of(f, i, sum);
            if (t.r[j] == 0.0 && f.z[i] >= f.saturation[i]) std::fill(J, J + K * d, 0.0);
        }
    }

    // Weights of the readings, from the residuals as they are: frozen until the next step is taken.
    void weigh(const Terms &t) {
        const double c2 = s.outlier_sigmas * s.outlier_sigmas;
        w.resize(t.r.size());
        for (size_t j = 0; j < w.size(); ++j) {
            const double e2 = t.r[j] * t.r[j] / t.v[j];
            double trust = 1;
            if (phase == 1 && e2 > c2) trust = std::sqrt(c2 / e2);
            if (phase == 2) trust = 1 / (1 + std::exp(std::min(0.5 * (e2 - c2), 700.0)));
            w[j] = trust / t.v[j];
        }
    }

    double cost(const std::vector<Source> &at, const Terms &t) const {
        double q = 0;
        for (size_t j = 0; j < w.size(); ++j) q += w[j] * t.r[j] * t.r[j];
        return q + penalty(at);
    }

    double penalty(const std::vector<Source> &at) const {
        double q = 0;
        for (const Source &c : at) {
            const double dx = c.x - f.x(c.leader), dy = c.y - f.y(c.leader);
            q += prior_place(c) * (dx * dx + dy * dy) + prior_factor() * c.log_factor * c.log_factor;
        }
        return q;
    }

    void normal(const std::vector<Source> &at, const Terms &t) {
        const size_t K = at.size(), m = K * d;
        A.assign(m * m, 0.0), g.assign(m, 0.0);
        for (size_t j = 0; j < w.size(); ++j) {
            const double *J = t.J.data() + j * m;
            for (size_t a = 0; a < m; ++a) {
                if (J[a] == 0.0) continue;
                const double wj = w[j] * J[a];
                g[a] += wj * t.r[j];
                for (size_t b = 0; b <= a; ++b) A[a * m + b] += wj * J[b];
            }
        }
        for (size_t k = 0; k < K; ++k) {
            const double p = prior_place(at[k]);
            A[(k * d) * m + k * d] += p;
            A[(k * d + 1) * m + k * d + 1] += p;
            g[k * d] -= p * (at[k].x - f.x(at[k].leader));
            g[k * d + 1] -= p * (at[k].y - f.y(at[k].leader));
            if (d == 3) {
                A[(k * d + 2) * m + k * d + 2] += prior_factor();
                g[k * d + 2] -= prior_factor() * at[k].log_factor;
            }
        }
    }

    bool factor(double damping) {
        const size_t m = g.size();
        L = A;
        for (size_t a = 0; a < m; ++a) L[a * m + a] += damping * A[a * m + a] + 1e-12 * A[a * m + a];
        for (size_t a = 0; a < m; ++a)
            for (size_t b = 0; b <= a; ++b) {
                double sum = L[a * m + b];
                for (size_t c = 0; c < b; ++c) sum -= L[a * m + c] * L[b * m + c];
                if (a == b) {
                    if (!(sum > 1e-14 * A[a * m + a])) return false;
                    L[a * m + a] = std::sqrt(sum);
                } else {
                    L[a * m + b] = sum / L[b * m + b];
                }
            }
        return true;
    }

    void back(std::vector<double> &v) const {
        const size_t m = g.size();
        for (size_t a = 0; a < m; ++a) {
            for (size_t c = 0; c < a; ++c) v[a] -= L[a * m + c] * v[c];
            v[a] /= L[a * m + a];
        }
        for (size_t a = m; a-- > 0;) {
            for (size_t c = a + 1; c < m; ++c) v[a] -= L[c * m + a] * v[c];
            v[a] /= L[a * m + a];
        }
    }

    bool solve(double damping) {
        promised = INFINITY;
        if (!factor(damping)) return false;
        step = g;
        back(step);
        promised = 0;
        for (size_t a = 0; a < step.size(); ++a) promised += 0.5 * step[a] * g[a];
        return true;
    }

    void move(std::vector<Source> &at) const {
        for (size_t k = 0; k < at.size(); ++k) {
            const double *p = step.data() + k * d;
            double share = std::min(1.0, s.max_step / std::max(std::hypot(p[0], p[1]), 1e-300));
            if (d == 3) share = std::min(share, kFactorStep / std::max(std::fabs(p[2]), 1e-300));
            at[k].x += share * p[0];
            at[k].y += share * p[1];
            if (d == 3) at[k].log_factor += share * p[2];
        }
    }

    bool few_are_off() const {
        size_t near = 0, off = 0;
        for (size_t j = 0; j < now.r.size(); ++j) {
            const double e = std::fabs(now.r[j]) / std::sqrt(now.v[j]);
            near += e > s.outlier_sigmas - 1;
            off += e > s.outlier_sigmas;
        }
        return near > 0 && double(off) <= kFew * double(now.r.size());
    }

    void finish(const std::vector<Source> &at, const Terms &t, Fit &o) const {
        const double c2 = s.outlier_sigmas * s.outlier_sigmas;
        o.sources = at;
        o.n = t.r.size();
        o.chi2 = 0;
        o.objective = -0.5 * penalty(at);
        for (size_t j = 0; j < o.n; ++j) {
            const double e2 = t.r[j] * t.r[j] / t.v[j];
            o.chi2 += e2;
            o.objective -= 0.5 * (std::min(e2, c2) + std::log(t.v[j]));
            o.objective += std::log1p(std::exp(-0.5 * std::fabs(e2 - c2)));
        }
    }

    void covariances(size_t K, Fit &o) {
        o.covariance.assign(3 * K, NAN);
        if (!factor(0)) return;
        for (size_t k = 0; k < K; ++k) {
            std::vector<double> x(g.size(), 0.0), y(g.size(), 0.0);
            x[k * d] = y[k * d + 1] = 1;
            back(x), back(y);
            o.covariance[3 * k] = x[k * d];
            o.covariance[3 * k + 1] = x[k * d + 1];
            o.covariance[3 * k + 2] = y[k * d + 1];
        }
    }

    const Field &f;
    const Settings &s;
    int64_t &spent;
    size_t d;
    int phase = 0;
    double promised = 0;
    Terms now, then;
    std::vector<double> w, A, L, g, step;
};

}  // namespace trackfield::signals
