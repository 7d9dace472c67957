// A straight pass fitted to amplitudes: Levenberg-Marquardt on the likelihood, Berger (3), (39).
//
// Unknown are log sqrt(P), position and velocity at time 0, by wish the exponent, and the clock of every
// sensor that may be wrong. Clocks are eliminated (each couples with its own sensor only), so that a step
// costs one pass over the samples and a system of 5 or 6 unknowns, however many sensors there are.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

namespace trackfield::trajectory {

constexpr int kMost = 6;  // log sqrt(P), x, y, vx, vy, exponent
constexpr double kCore2 = 1e-18;  // a target nearer than 1e-9 m counts as this near

using Unknowns = std::array<double, kMost>;

// One sensor: where it stands, how it hears, and the samples [first, last) that are its own.
struct Sensor {
    double x, y, exponent, sigma, saturation, clock_sigma;
    bool rayleigh;
    size_t first, last;
};

// Cost of one sample, its slope downhill in the amplitude, and the Fisher information about that.
struct Term {
    double cost, score, weight;
};

struct Samples {
    std::vector<Sensor> sensors;
    const double *t, *value;
    int free;  // unknowns besides clocks: 5, or 6 with the exponent
};

inline double normal_density(double c) { return 0.3989422804014327 * std::exp(-0.5 * c * c); }

// -log Q(c) and the hazard phi(c) / Q(c), where Q is the normal tail; asymptotic where Q underflows.
inline std::array<double, 2> tail(double c) {
    if (c > 25.0) return {0.5 * c * c + std::log(c) + 0.9189385332046727, c + 1.0 / c};
    const double q = 0.5 * std::erfc(c * 0.7071067811865476);
    return {-std::log(q), normal_density(c) / q};
}

inline Term gaussian(const Sensor &s, double z, double a) {
    const double precision = 1.0 / (s.sigma * s.sigma);
    if (!std::isfinite(s.saturation)) return {0.5 * (z - a) * (z - a) * precision, (z - a) * precision, precision};
    const double c = (s.saturation - a) / s.sigma;
    const auto [loss, hazard] = tail(c);
    // Of a sample that may be cut: what those below tell, and that the others are cut.
    const double density = normal_density(c), below = 0.5 * std::erfc(-c * 0.7071067811865476);
    const double weight = std::max(below - c * density + density * hazard, 0.0) * precision;
    if (z >= s.saturation) return {loss, hazard / s.sigma, weight};
    return {0.5 * (z - a) * (z - a) * precision, (z - a) * precision, weight};
}

inline Term fading(const Sensor &s, double z, double a) {
    const double m = s.sigma * s.sigma + a * a, slope = 2.0 * a / m;
    const double cut = std::isfinite(s.saturation) ? s.saturation * s.saturation / m : INFINITY;
    const double weight = slope * slope * -std::expm1(-cut);
    if (z >= s.saturation) return {cut, cut * slope, weight};
    return {std::log(m) + z * z / m, (z * z / m - 1.0) * slope, weight};
}

// Cost and normal equations at a place, clocks eliminated later: H step = g, per sensor h, d, e.
struct Equations {
    double H[kMost][kMost], g[kMost];
    std::vector<Unknowns> h;  // coupling of a clock with the others
    std::vector<double> d, e, cost;  // a clock's information and slope; cost by sensor
    double total;
};

struct Place {
    Unknowns u;
    std::vector<double> clock;
};

inline void evaluate(const Samples &given, const Place &at, Equations &out) {
    const size_t sensors = given.sensors.size();
    out = {};
    out.h.assign(sensors, {}), out.d.assign(sensors, 0.0), out.e.assign(sensors, 0.0), out.cost.assign(sensors, 0.0);
    const Unknowns &u = at.u;
    for (size_t k = 0; k < sensors; ++k) {
        const Sensor &s = given.sensors[k];
        const double alpha = s.exponent + u[5];
        for (size_t i = s.first; i < s.last; ++i) {
            const double t = given.t[i] - at.clock[k];
            const double dx = u[1] + t * u[3] - s.x, dy = u[2] + t * u[4] - s.y, r2 = std::max(dx * dx + dy * dy, kCore2);
            const double log_r2 = std::log(r2), a = std::exp(std::min(u[0] - 0.5 * alpha * log_r2, 300.0));
            const Term term = s.rayleigh ? fading(s, given.value[i], a) : gaussian(s, given.value[i], a);
            out.cost[k] += term.cost;
            const double f = -alpha * a / r2, gx = f * dx, gy = f * dy;
            const double J[kMost] = {a, gx, gy, gx * t, gy * t, -0.5 * a * log_r2};
            for (int i = 0; i < given.free; ++i) {
                out.g[i] += J[i] * term.score;
                for (int j = 0; j <= i; ++j) out.H[i][j] += J[i] * J[j] * term.weight;
            }
            if (s.clock_sigma > 0.0) {
                const double b = -(gx * u[3] + gy * u[4]);
                for (int i = 0; i < given.free; ++i) out.h[k][i] += J[i] * b * term.weight;
                out.d[k] += b * b * term.weight;
                out.e[k] += b * term.score;
            }
        }
        if (s.clock_sigma > 0.0) {
            const double precision = 1.0 / (s.clock_sigma * s.clock_sigma), b = at.clock[k];
            out.cost[k] += 0.5 * b * b * precision;
            out.d[k] += precision;
            out.e[k] -= b * precision;
        }
        out.total += out.cost[k];
    }
}

// Eliminate the clocks, damped like the rest: what is left of H and g.
inline void reduce(const Samples &given, const Equations &from, double damping, double (&H)[kMost][kMost], double (&g)[kMost]) {
    for (int i = 0; i < given.free; ++i) {
        g[i] = from.g[i];
        for (int j = 0; j <= i; ++j) H[i][j] = from.H[i][j];
        H[i][i] *= 1.0 + damping;
    }
    for (size_t k = 0; k < given.sensors.size(); ++k) {
        if (from.d[k] <= 0.0) continue;
        const double d = from.d[k] * (1.0 + damping);
        for (int i = 0; i < given.free; ++i) {
            g[i] -= from.h[k][i] * from.e[k] / d;
            for (int j = 0; j <= i; ++j) H[i][j] -= from.h[k][i] * from.h[k][j] / d;
        }
    }
}

// Solve H x = g by Cholesky on the matrix scaled to a unit diagonal; false where it is not definite.
inline bool solve(int n, const double (&H)[kMost][kMost], const double (&g)[kMost], Unknowns &x) {
    double L[kMost][kMost], scale[kMost];
    for (int i = 0; i < n; ++i) {
        if (!(H[i][i] > 0.0) || !std::isfinite(H[i][i])) return false;
        scale[i] = 1.0 / std::sqrt(H[i][i]);
    }
    for (int i = 0; i < n; ++i) {
        for (int j = 0; j <= i; ++j) {
            double sum = H[i][j] * scale[i] * scale[j] + (i == j ? 1e-13 : 0.0);
            for (int k = 0; k < j; ++k) sum -= L[i][k] * L[j][k];
            if (i == j && !(sum > 0.0)) return false;
            L[i][j] = i == j ? std::sqrt(sum) : sum / L[j][j];
        }
    }
    x = {};
    for (int i = 0; i < n; ++i) {
        double sum = g[i] * scale[i];
        for (int k = 0; k < i; ++k) sum -= L[i][k] * x[k];
        x[i] = sum / L[i][i];
    }
    for (int i = n - 1; i >= 0; --i) {
        for (int k = i + 1; k < n; ++k) x[i] -= L[k][i] * x[k];
        x[i] /= L[i][i];
    }
    for (int i = 0; i < n; ++i) {
        x[i] *= scale[i];
        if (!std::isfinite(x[i])) return false;
    }
    return true;
}

struct Fit {
    Place at;
    Equations end;
    int iterations;
    bool converged;
};

// Downhill from `start`; ends where a step promises less than `done` of cost, or after `most` trials.
inline Fit descend(const Samples &given, const Unknowns &start, int most, double done) {
    Fit fit{{start, std::vector<double>(given.sensors.size(), 0.0)}, {}, 0, false};
    evaluate(given, fit.at, fit.end);
    Equations next;
    Place trial = fit.at;
    double damping = 1e-3, H[kMost][kMost], g[kMost];
    for (; fit.iterations < most && damping < 1e12; ++fit.iterations) {
        Unknowns step;
        reduce(given, fit.end, damping, H, g);
        if (!solve(given.free, H, g, step)) {
            damping *= 10.0;
            continue;
        }
        double gain = 0.0;
        for (int i = 0; i < given.free; ++i) gain += 0.5 * g[i] * step[i];
        for (size_t k = 0; k < given.sensors.size(); ++k) {
            trial.clock[k] = fit.at.clock[k];
            if (fit.end.d[k] <= 0.0) continue;
            double move = fit.end.e[k];
            for (int i = 0; i < given.free; ++i) move -= fit.end.h[k][i] * step[i];
            const double d = fit.end.d[k] * (1.0 + damping);
            trial.clock[k] += move / d;
            gain += 0.5 * fit.end.e[k] * fit.end.e[k] / d;
        }
        if (gain <= done && damping < 1.0) {
            fit.converged = true;
            break;
        }
        // Far from the end, a step in the logarithm of the power is bounded.
        const double shrink = std::min(1.0, 2.0 / std::max(std::abs(step[0]), 1e-300));
        for (int i = 0; i < given.free; ++i) trial.u[i] = fit.at.u[i] + shrink * step[i];
        evaluate(given, trial, next);
        if (next.total <= fit.end.total + 1e-14 * (1.0 + std::abs(fit.end.total))) {
            std::swap(fit.at, trial);
            std::swap(fit.end, next);
            trial = fit.at;
            damping = damping > 1e-9 ? 0.2 * damping : 0.0;
        } else {
            damping = std::max(5.0 * damping, 1e-4);
        }
    }
    return fit;
}

}  // namespace trackfield::trajectory
