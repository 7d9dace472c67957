// The pass that explains all messages best, from a start: Levenberg-Marquardt.
#pragma once
#include <array>
#include <limits>

#include "passes_message.hpp"

namespace trackfield::passes {

// [log Q, x, y, log speed, heading, alpha], the place at time 0. Near a sensor that the target almost touched the messages
// fix place, time and |v|^2 / Q a thousand times better than the heading: with time 0 there that valley is straight in
// these coordinates, and curved in those of the velocity.
constexpr int STATES = 6;
using Column = std::array<double, STATES>;
using Square = std::array<Column, STATES>;

struct Terms {
    double half = 0.0;
    Column g{};
    Square F{};  // clock errors marginalised
};

struct Fit {
    Column state{};
    std::vector<double> clocks;
    Square F{};
    double half = std::numeric_limits<double>::infinity();
    bool converged = false;
};

// Lower Cholesky factor of F + damping diag F, n rows; false where that is not positive definite.
inline bool factor(const Square &F, double damping, int n, Square &L) {
    for (int i = 0; i < n; ++i)
        for (int j = 0; j <= i; ++j) {
            double v = F[i][j] * (i == j ? 1.0 + damping : 1.0);
            for (int k = 0; k < j; ++k) v -= L[i][k] * L[j][k];
            if (i != j)
                L[i][j] = v / L[j][j];
            else if (v > 1e-15 * F[i][i])
                L[i][i] = std::sqrt(v);
            else
                return false;
        }
    return true;
}

inline Column solve(const Square &L, const Column &b, int n) {
    Column x{};
    for (int i = 0; i < n; ++i) {
        double v = b[i];
        for (int k = 0; k < i; ++k) v -= L[i][k] * x[k];
        x[i] = v / L[i][i];
    }
    for (int i = n - 1; i >= 0; --i) {
        double v = x[i];
        for (int k = i + 1; k < n; ++k) v -= L[k][i] * x[k];
        x[i] = v / L[i][i];
    }
    return x;
}

// What the search knows of one sensor's clock error: slope, curvature, and how it goes with the states.
struct Clock {
    double g = 0.0, F = 1.0;
    Column h{};
};

// All messages of one pass.
class Pass {
   public:
    std::vector<Message> messages;
    double alpha = 1.0, alpha_weight = 0.0;  // the exponent, and the weight of that as a prior where it is a state
    int n = 5;                               // states, 6 with the exponent
    bool clocks = false;                     // some clock is in doubt

    // Of a state, what all messages share: 1/Q, place and velocity at time 0.
    struct Way {
        double q, x, y, vx, vy;
        explicit Way(const Column &s) : q(std::exp(-s[0])), x(s[1]), y(s[2]), vx(std::exp(s[3])), vy(vx * std::sin(s[4])) { vx *= std::cos(s[4]); }
        // As a sensor sees it whose clock is ahead by `late`.
        Quadratic from(const Message &m, double late = 0.0) const {
            const double dx = x - late * vx - m.x, dy = y - late * vy - m.y;
            return {q * (dx * dx + dy * dy), 2.0 * q * (dx * vx + dy * vy), q * (vx * vx + vy * vy)};
        }
    };

    // Half the deviance of all messages, clocks believed; not summed further than `enough`.
    double half(const Column &s, double enough = std::numeric_limits<double>::infinity()) const {
        double sum = 0.0;
        const Way way(s);
        for (const Message &m : messages) {
            sum += m.half(way.from(m), s[5]);
            if (!(sum < enough)) break;
        }
        return sum;
    }

    // The same with slopes; `late` are the clock errors at which it is taken, `about` what is known of them.
    Terms terms(const Column &s, const std::vector<double> &late, std::vector<Clock> &about) const {
        Terms out;
        const Way way(s);
        const double q = way.q, vx = 2.0 * q * way.vx, vy = 2.0 * q * way.vy;
        for (size_t k = 0; k < messages.size(); ++k) {
            const Message &m = messages[k];
            const double tau = clocks ? late[k] : 0.0;
            const Quadratic w = way.from(m, tau);
            const Evidence e = m.evidence(w, s[5], n == STATES);
            out.half += e.half;
            const double dx = 2.0 * q * (s[1] - m.x) - tau * vx, dy = 2.0 * q * (s[2] - m.y) - tau * vy;
            const double turn = (dy * vx - dx * vy) / (2.0 * q);
            // slopes of (c0, c1, c2) in [log Q, x, y, log speed, heading] and in the clock error
            const double J[3][6] = {{-w.c0, dx, dy, -tau * w.c1, -tau * turn, -w.c1},
                                    {-w.c1, vx, vy, w.c1 - 2.0 * tau * w.c2, turn, -2.0 * w.c2},
                                    {-w.c2, 0.0, 0.0, 2.0 * w.c2, 0.0, 0.0}};
            const int columns = clocks ? 6 : 5;
            double rows[6][4];
            for (int a = 0; a < columns; ++a)
                for (int j = 0; j < 4; ++j) rows[a][j] = J[0][a] * e.F[0][j] + J[1][a] * e.F[1][j] + J[2][a] * e.F[2][j];
            const auto along = [&](int a, const double *by) { return by[0] * J[0][a] + by[1] * J[1][a] + by[2] * J[2][a]; };
            for (int a = 0; a < 5; ++a) {
                out.g[a] += along(a, e.g);
                for (int b = a; b < 5; ++b) out.F[a][b] += along(b, rows[a]);
                if (n == STATES) out.F[a][5] += rows[a][3];
            }
            if (n == STATES) out.g[5] += e.g[3], out.F[5][5] += e.F[3][3];
            if (!clocks) continue;
            const double prior = 1.0 / std::max(m.clock * m.clock, 1e-18);
            Clock &c = about[k];
            out.half += 0.5 * prior * tau * tau;
            c.g = along(5, e.g) + prior * tau, c.F = along(5, rows[5]) + prior;
            for (int a = 0; a < 5; ++a) c.h[a] = along(a, rows[5]);
            c.h[5] = n == STATES ? rows[5][3] : 0.0;
            for (int a = 0; a < n; ++a) {
                out.g[a] -= c.h[a] * c.g / c.F;
                for (int b = a; b < n; ++b) out.F[a][b] -= c.h[a] * c.h[b] / c.F;
            }
        }
        if (n == STATES) {
            const double off = s[5] - alpha;
            out.half += 0.5 * alpha_weight * off * off, out.g[5] += alpha_weight * off, out.F[5][5] += alpha_weight;
        }
        for (int a = 0; a < n; ++a)
            for (int b = 0; b < a; ++b) out.F[a][b] = out.F[b][a];
        return out;
    }

    // At most `most` steps, until one promises a gain below `done`, or until `met` knows the state: half is infinite then.
    template <class Met>
    Fit descend(const Column &start, int most, double done, const Met &met) const {
        Fit fit;
        fit.state = start, fit.clocks.assign(messages.size(), 0.0);
        std::vector<Clock> about(messages.size()), then_about(messages.size());
        std::vector<double> late = fit.clocks;
        Terms at = terms(fit.state, fit.clocks, about);
        double damping = 1e-3;
        for (int i = 0; i < most && damping < 1e12; ++i) {
            Square L{};
            if (!factor(at.F, damping, n, L)) {
                damping = std::max(10.0 * damping, 1e-6);
                continue;
            }
            Column x = solve(L, at.g, n);
            double gain = 0.0;
            for (int a = 0; a < n; ++a) gain += 0.5 * at.g[a] * x[a];
            if (clocks)
                for (const Clock &c : about) gain += 0.5 * c.g * c.g / c.F;
            if (gain <= done * (1.0 + at.half) && damping < 1.0) {
                fit.converged = true;
                break;
            }
            // no step leads further than the quadratic is to be believed
            const double far = std::max({1.0, std::abs(x[0]) / 3.0, std::abs(x[3]), std::abs(x[4])});
            Column trial = fit.state;
            for (int a = 0; a < n; ++a) x[a] /= far, trial[a] -= x[a];
            trial[5] = std::clamp(trial[5], 0.2, 8.0);
            if (clocks)
                for (size_t k = 0; k < late.size(); ++k) {
                    double d = about[k].g;
                    for (int a = 0; a < n; ++a) d -= about[k].h[a] * x[a];
                    late[k] = fit.clocks[k] - d / about[k].F;
                }
            const Terms then = terms(trial, late, then_about);
            if (then.half <= at.half) {
                fit.state = trial, fit.clocks = late, at = then;
                std::swap(about, then_about);
                if (met(trial)) return fit;
                damping = damping > 1e-7 ? 0.2 * damping : 0.0;
            } else
                damping = std::max(6.0 * damping, 1e-3);
        }
        fit.half = at.half, fit.F = at.F;
        return fit;
    }
};

}  // namespace trackfield::passes
