// Levenberg-Marquardt from one start: damped by the curvature's own diagonal, so that metres and metres
// a second need no common measure.
#pragma once

#include <algorithm>

#include "motion_terms.hpp"

namespace trackfield::motion {

constexpr double kDone = 1e-22;      // promised gain [nats] at which a search ends
constexpr double kLeft = 1e-16;      // the same as a share of the cost
constexpr double kEnough = 1e-8;     // and what is called an end where no iterations are left
constexpr int kStraight = 40;        // iterations of Gauss-Newton, before the whole curvature is used
constexpr double kStuck = 1e12;      // damping from which on no step is left
constexpr double kFirst = 1e-3;      // damping of the first step
constexpr double kRounding = 1e-15;  // of an expected reading; it must not keep a search from ending

template <int d>
struct Descent {
    double state[2 * d];
    Terms<d> at;
    int iterations = 0;
    bool converged = false;
};

// Solves (A + damping diag A) x = -g for lower A; the promised fall of cost, or -1 where A has no root.
template <int d>
inline double step(const Terms<d> &at, double damping, double *x) {
    constexpr int n = 2 * d;
    double l[n][n], largest = 0;
    for (int a = 0; a < n; ++a) largest = std::fmax(largest, at.curvature[a][a]);
    for (int a = 0; a < n; ++a) {
        for (int b = 0; b <= a; ++b) {
            double sum = at.curvature[a][b];
            // a direction of which nothing is said is held by a sliver of what the others weigh
            if (a == b) sum += damping * sum + 1e-15 * largest;
            for (int k = 0; k < b; ++k) sum -= l[a][k] * l[b][k];
            if (a == b) {
                if (!(sum > 0)) return -1;
                l[a][a] = std::sqrt(sum);
            } else {
                l[a][b] = sum / l[b][b];
            }
        }
    }
    double gain = 0;
    for (int a = 0; a < n; ++a) {
        x[a] = -at.gradient[a];
        for (int k = 0; k < a; ++k) x[a] -= l[a][k] * x[k];
        x[a] /= l[a][a];
        gain += 0.5 * x[a] * x[a];
    }
    for (int a = n - 1; a >= 0; --a) {
        for (int k = a + 1; k < n; ++k) x[a] -= l[k][a] * x[k];
        x[a] /= l[a][a];
    }
    return gain;
}

// The whole curvature of the cost, by differences of the gradient over a thousandth of a standard
// deviation: along a bent valley Gauss-Newton's converges slowly or not at all.
template <int d>
inline Terms<d> bent(const Readings &z, const double *state, const Terms<d> &at) {
    Terms<d> o = at, up, down;
    double moved[2 * d];
    for (int a = 0; a < 2 * d; ++a) {
        const double h = 1e-3 / std::sqrt(at.curvature[a][a]);
        if (!std::isfinite(h)) return at;
        std::copy(state, state + 2 * d, moved);
        moved[a] = state[a] + h;
        terms<d>(z, moved, up);
        moved[a] = state[a] - h;
        terms<d>(z, moved, down);
        for (int b = 0; b < 2 * d; ++b) o.curvature[a][b] = (up.gradient[b] - down.gradient[b]) / (2.0 * h);
    }
    for (int a = 0; a < 2 * d; ++a)
        for (int b = 0; b < a; ++b) o.curvature[a][b] = 0.5 * (o.curvature[a][b] + o.curvature[b][a]);
    return o;
}

// Ends early where it is farther than `reach` from `centre`: nothing there comes back.
template <int d>
inline Descent<d> descend(const Readings &z, const double *start, const double *centre, double reach, int iterations) {
    Descent<d> o;
    for (int k = 0; k < 2 * d; ++k) o.state[k] = start[k];
    terms<d>(z, o.state, o.at);
    double damping = kFirst, rounding = 0;
    for (size_t i = 0; i < z.n; ++i) {
        const double share = kRounding * (1.0 + std::fabs(z.value[i])) / z.sigma[i];
        rounding += share * share;
    }
    while (o.iterations < iterations && damping < kStuck) {
        double move[2 * d], trial[2 * d], away = 0;
        double gain = -1;
        if (o.iterations >= kStraight) gain = step<d>(bent<d>(z, o.state, o.at), damping, move);
        if (gain < 0) gain = step<d>(o.at, damping, move);
        // without damping it would promise up to (1 + damping) times as much
        if (gain >= 0 && gain * (1.0 + damping) <= kDone + kLeft * o.at.cost + rounding) {
            o.converged = true;
            break;
        }
        o.converged = gain >= 0 && gain * (1.0 + damping) <= kEnough;
        ++o.iterations;
        for (int k = 0; k < 2 * d; ++k) trial[k] = o.state[k] + move[k];
        for (int k = 0; k < d; ++k) away += (trial[k] - centre[k]) * (trial[k] - centre[k]);
        if (gain < 0 || !(away < 1e4 * reach * reach)) {
            damping = damping * 8.0;
            continue;
        }
        Terms<d> then;
        terms<d>(z, trial, then);
        if (then.cost <= o.at.cost - 1e-4 * gain + 1e-15 * o.at.cost + rounding) {
            for (int k = 0; k < 2 * d; ++k) o.state[k] = trial[k];
            o.at = then;
            damping = std::fmax(0.2 * damping, 1e-14);
            double far = 0;
            for (int k = 0; k < d; ++k) far += (o.state[k] - centre[k]) * (o.state[k] - centre[k]);
            if (far > reach * reach) break;
        } else {
            damping = std::fmax(damping * 6.0, 1e-6);
        }
    }
    return o;
}

}  // namespace trackfield::motion
