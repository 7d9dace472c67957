// Maximum-likelihood fit of a pass to one sensor's samples, within limits: Newton's
// method, damped, by Fisher's matrix where the likelihood is not convex.
#pragma once

#include <array>

#include "profile_starts.hpp"

namespace trackfield::profiles {

constexpr int kIterations = 300;
constexpr double kDone = 1e-9;   // promised gain [nats] at which a fit ends
constexpr double kLeast = 1e-3;  // least amplitude, in sigmas: at zero all profiles are one
constexpr double kMost = 1000.0;  // largest amplitude, in largest samples
constexpr double kStride = 1.0;  // longest step, in log amplitude, log width and in widths
constexpr double kAlike = 0.7;    // a start within so many widths, and e-folds of width, of a fit leads to it
constexpr double kHope = 4.0;     // so much less likely than a fit a start may be [nats], and
constexpr double kHopeShare = 0.1;  // this share of what the fit gains over nothing
constexpr double kBeyond = 0.25;  // out of the record a pass is at least so wide, in times to it

struct Fit {
    double a = 0, tm = 0, width = 0;
    double cost = INFINITY;
    int iterations = 0;
    bool converged = false;
};

// One sensor's samples. What is searched: log amplitude, time, and log of the width less what it has to
// be beyond the record, where only amplitude times width^alpha is told.
class Fitter {
   public:
    Fitter(const double *t, const double *r, size_t n, const Shape &shape, const Noise &noise, const Limits &limits)
        : t(t), r(r), n(n), shape(shape), noise(noise), limits(limits) {
        low = {std::log(kLeast * noise.sigma), limits.earliest, std::log(limits.narrowest)};
        const double top = std::max(*std::max_element(r, r + n), noise.sigma);
        high = {std::log(kMost * top), limits.latest, std::log(limits.widest)};
        for (size_t i = 0; noise.rayleigh && i < n; ++i)
            if (r[i] < noise.saturation) constant += 2.0 * std::log(noise.sigma) - std::log(2.0 * std::max(r[i], 1e-300));
        if (!noise.rayleigh) constant = double(n) * (std::log(noise.sigma) + kLogRoot2Pi);
    }

    Fit run(const Numbers &start) const {
        Point x = point(start);
        Fit o;
        Terms now = terms(x);
        double damping = 1e-3;
        for (; o.iterations < kIterations; ++o.iterations) {
            Point step{};
            const double promised = solve(now, x, damping, step);
            if (promised <= kDone + 1e-14 * std::abs(now.cost) && damping < 1.0) {
                o.converged = true;
                break;
            }
            const Point trial = moved(x, step);
            const Terms then = terms(trial);
            if (then.cost <= now.cost) {
                x = trial, now = then;
                damping = damping > 1e-7 ? 0.1 * damping : 0.0;
            } else {
                if (damping > 1e12) break;
                damping = std::max(5.0 * damping, 1e-3);
            }
        }
        o.a = std::exp(x[0]), o.tm = x[1], o.width = std::exp(x[2]) + least(x[1]);
        o.cost = now.cost + constant;
        return o;
    }

    // From the paper's start, and from others that may lead to a likelier profile.
    Fit best(const Numbers &first, const std::vector<Numbers> &others) const {
        Fit o = run(first);
        const double hope = kHope + kHopeShare * std::max(flat_cost(0.0) - o.cost, 0.0);
        for (const Numbers &start : others) {
            const bool alike = std::abs(start.tm - o.tm) < kAlike * std::min(o.width, start.width) &&
                               std::abs(std::log(start.width / o.width)) < kAlike;
            if (alike || terms(point(start)).cost + constant > o.cost + hope) continue;
            Fit found = run(start);
            found.iterations += o.iterations, o.iterations = found.iterations;
            if (found.cost < o.cost) o = found;
        }
        return o;
    }

    // Of an amplitude that never changes.
    double flat_cost(double mean) const { return flat(mean).cost + constant; }

    // Of the best of them.
    double best_flat_cost() const {
        double sum = 0;
        for (size_t i = 0; i < n; ++i) sum += noise.rayleigh ? r[i] * r[i] : r[i];
        double a = sum / double(n);
        if (noise.rayleigh) a = std::sqrt(std::max(a - noise.sigma * noise.sigma, 0.0));
        a = std::max(a, 0.0);
        Sample now = flat(a);
        for (int k = 0; !std::isinf(noise.saturation) && k < kIterations; ++k) {
            const double step = -now.slope / (now.expected + 1e-300);
            const double trial = std::max(a + std::clamp(step, -noise.sigma, noise.sigma), 0.0);
            const Sample then = flat(trial);
            if (then.cost >= now.cost - kDone) break;
            a = trial, now = then;
        }
        return now.cost + constant;
    }

   private:
    using Point = std::array<double, 3>;
    struct Terms {
        double cost = 0, g[3]{}, K[3][3]{}, J[3][3]{};  // slope, second slope, Fisher's matrix
    };

    const double *t, *r;
    size_t n;
    const Shape &shape;
    const Noise &noise;
    const Limits &limits;
    Point low{}, high{};
    double constant = 0;

    // The width a pass has at least beyond the record, and its slope in the time.
    double least(double tm) const { return kBeyond * std::max({0.0, t[0] - tm, tm - t[n - 1]}); }
    double least_slope(double tm) const { return tm < t[0] ? -kBeyond : tm > t[n - 1] ? kBeyond : 0.0; }

    Point point(const Numbers &at) const {
        Point x{std::log(at.a), at.tm, std::log(std::max(at.width - least(at.tm), limits.narrowest))};
        for (size_t j = 0; j < 3; ++j) x[j] = std::clamp(x[j], low[j], high[j]);
        return x;
    }

    Point moved(const Point &x, const Point &step) const {
        const double stride[3] = {kStride, kStride * (std::exp(x[2]) + least(x[1])), kStride};
        Point o;
        for (size_t j = 0; j < 3; ++j) o[j] = std::clamp(x[j] + std::clamp(step[j], -stride[j], stride[j]), low[j], high[j]);
        return o;
    }

    Sample one(double value, double a, LogSum &logs) const {
        if (!noise.rayleigh) return plain_sample(noise, value, a);
        const double x = 1.0 + a * a / (noise.sigma * noise.sigma);
        if (value < noise.saturation) logs.add(x);
        return faded_sample(noise, value, a, x);
    }

    Sample flat(double a) const {
        Sample o;
        LogSum logs;
        for (size_t i = 0; i < n; ++i) {
            const Sample s = one(r[i], a, logs);
            o.cost += s.cost, o.slope += s.slope, o.expected += s.expected;
        }
        o.cost += logs.total();
        return o;
    }

    Terms terms(const Point &x) const {
        Terms o;
        LogSum logs;
        const double a = std::exp(x[0]), free = std::exp(x[2]), per_width = 1.0 / (free + least(x[1]));
        const double ahead = least_slope(x[1]);
        for (size_t i = 0; i < n; ++i) {
            const double tau = (t[i] - x[1]) * per_width, q = 1.0 + shape.c * tau * tau, mean = a * shape.falloff(q);
            // slopes of the log amplitude: in tau; in time and width; in what is searched
            const double by_tau = -shape.alpha * shape.c * tau / q * per_width;
            const double by_tau2 = -shape.alpha * shape.c * (2.0 - q) / (q * q) * per_width * per_width;
            const double by_width = -by_tau * tau, mixed = by_tau2 * tau + by_tau * per_width;
            const double by_width2 = mixed * tau + by_tau * per_width * tau;
            const double slope[3] = {1.0, -by_tau + ahead * by_width, free * by_width};
            const double two[3][3] = {{0, 0, 0},
                                      {0, by_tau2 + ahead * (2.0 * mixed + ahead * by_width2), 0},
                                      {0, free * (mixed + ahead * by_width2), free * (free * by_width2 + by_width)}};
            const Sample s = one(r[i], mean, logs);
            o.cost += s.cost;
            for (int j = 0; j < 3; ++j) {
                o.g[j] += s.slope * mean * slope[j];
                for (int k = 0; k <= j; ++k) {
                    const double square = mean * slope[j] * slope[k];
                    o.J[j][k] += s.expected * mean * square;
                    o.K[j][k] += s.second * mean * square + s.slope * (square + mean * two[j][k]);
                }
            }
        }
        o.cost += logs.total();
        return o;
    }

    // A step that leaves alone what stands at a limit and is drawn beyond it; the gain it promises.
    double solve(const Terms &now, const Point &x, double damping, Point &step) const {
        bool held[3];
        for (size_t j = 0; j < 3; ++j) held[j] = (x[j] <= low[j] && now.g[j] > 0) || (x[j] >= high[j] && now.g[j] < 0);
        if (!solve_by(now.K, now, held, damping, step)) solve_by(now.J, now, held, damping + 1e-9, step);
        double promised = 0;
        for (size_t j = 0; j < 3; ++j) promised -= held[j] ? 0.0 : 0.5 * now.g[j] * step[j];
        return promised;
    }

    // False where the curvature is not positive definite; Fisher's matrix, damped, always is taken.
    bool solve_by(const double (&C)[3][3], const Terms &now, const bool (&held)[3], double damping, Point &step) const {
        double L[3][3], y[3];
        for (int j = 0; j < 3; ++j) {
            y[j] = held[j] ? 0.0 : -now.g[j];
            for (int k = 0; k <= j; ++k) {
                double sum = held[j] || held[k] ? 0.0 : C[j][k];
                if (j == k) sum = held[j] ? 1.0 : sum + damping * now.J[j][j];
                for (int m = 0; m < k; ++m) sum -= L[j][m] * L[k][m];
                if (j == k && &C == &now.K && !(sum > 1e-6 * now.J[j][j])) return false;
                L[j][k] = j == k ? std::sqrt(std::max(sum, 1e-12 * now.J[j][j] + 1e-300)) : sum / L[k][k];
            }
            for (int m = 0; m < j; ++m) y[j] -= L[j][m] * y[m];
            y[j] /= L[j][j];
        }
        for (int j = 2; j >= 0; --j) {
            for (int m = j + 1; m < 3; ++m) y[j] -= L[m][j] * y[m];
            y[j] /= L[j][j];
            step[size_t(j)] = y[j];
        }
        return true;
    }
};

}  // namespace trackfield::profiles
