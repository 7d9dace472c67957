// Where a search sets out: the closed forms of pairs of messages, and the lifted linear one of three or more.
#pragma once
#include "passes_fit.hpp"

namespace trackfield::passes {

constexpr double FASTEST = 1e12;  // in fields a width of time: faster is not a pass

// Four passes that send these two messages, of sides (+-), (-+), (++), (--) of n = R90 v/|v|; without those of infinite speed.
inline void pair(const Message &m1, const Message &m2, double alpha, std::vector<Column> &out) {
    const double root = std::sqrt(steepness(alpha)), dx = m2.x - m1.x, dy = m2.y - m1.y, D = std::hypot(dx, dy);
    if (!m1.heard || !m2.heard || !(D > 0.0)) return;
    constexpr double SIDES[4][2] = {{1.0, -1.0}, {-1.0, 1.0}, {1.0, 1.0}, {-1.0, -1.0}};
    for (const auto &[s1, s2] : SIDES) {
        const double S = -(s1 * m1.width - s2 * m2.width) / root, C = m2.t - m1.t, H = std::hypot(S, C), v = D / H;
        if (!(v < FASTEST)) continue;
        const double ux = (dx * C - dy * S) / (D * H), uy = (dx * S + dy * C) / (D * H);
        const double d1 = m1.width * v / root, d2 = m2.width * v / root;
        const double q = (std::log(m1.a) + std::log(m2.a)) / alpha + std::log(d1) + std::log(d2);
        out.push_back({q, m1.x - s1 * d1 * uy - m1.t * v * ux, m1.y + s1 * d1 * ux - m1.t * v * uy, std::log(v), std::atan2(uy, ux), alpha});
    }
}

// w of a sensor is linear in [1/Q, x/Q, y/Q, |x|^2/Q, vx/Q, vy/Q, v.x/Q, |v|^2/Q]: least squares with the messages' own
// Fisher matrices. Three sensors leave 1/Q free, which then is |v/Q|^2 / (|v|^2/Q). False where that is no pass.
inline bool lifted(const Pass &pass, Column &out) {
    constexpr int M = 8;
    double N[M][M] = {}, b[M] = {};
    for (const Message &m : pass.messages) {
        if (!m.heard) continue;
        const Quadratic w = m.own(pass.alpha);
        const Evidence e = m.evidence(w, pass.alpha, false);
        const double H[3][M] = {{m.x * m.x + m.y * m.y, -2.0 * m.x, -2.0 * m.y, 1.0, 0.0, 0.0, 0.0, 0.0},
                                {0.0, 0.0, 0.0, 0.0, -2.0 * m.x, -2.0 * m.y, 2.0, 0.0},
                                {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0}};
        const double c[3] = {w.c0, w.c1, w.c2};
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j)
                for (int r = 0; r < M; ++r) {
                    const double f = H[i][r] * e.F[i][j];
                    if (f == 0.0) continue;
                    b[r] += f * c[j];
                    for (int s = 0; s < M; ++s) N[r][s] += f * H[j][s];
                }
    }
    // the unknowns but the first, alone and as they go with it
    double L[M][M] = {}, apart[M] = {}, along[M] = {1.0};
    for (int i = 1; i < M; ++i)
        for (int j = 1; j <= i; ++j) {
            double v = N[i][j];
            for (int k = 1; k < j; ++k) v -= L[i][k] * L[j][k];
            if (i != j)
                L[i][j] = v / L[j][j];
            else if (v > 1e-13 * N[i][i])
                L[i][i] = std::sqrt(v);
            else
                return false;
        }
    for (int i = 1; i < M; ++i) {
        apart[i] = b[i], along[i] = -N[i][0];
        for (int k = 1; k < i; ++k) apart[i] -= L[i][k] * apart[k], along[i] -= L[i][k] * along[k];
        apart[i] /= L[i][i], along[i] /= L[i][i];
    }
    for (int i = M - 1; i > 0; --i) {
        for (int k = i + 1; k < M; ++k) apart[i] -= L[k][i] * apart[k], along[i] -= L[k][i] * along[k];
        apart[i] /= L[i][i], along[i] /= L[i][i];
    }
    double top = b[0], bottom = N[0][0], z[M];
    for (int k = 1; k < M; ++k) top -= N[0][k] * apart[k], bottom += N[0][k] * along[k];
    const double first = bottom > 1e-11 * N[0][0] ? top / bottom : (apart[4] * apart[4] + apart[5] * apart[5]) / apart[7];
    for (int k = 0; k < M; ++k) z[k] = apart[k] + first * along[k];
    const double vx = z[4] / z[0], vy = z[5] / z[0], v = std::hypot(vx, vy);
    if (!(z[0] > 0.0) || !(v > 1.0 / FASTEST) || !(v < FASTEST)) return false;
    out = {-std::log(z[0]), z[1] / z[0], z[2] / z[0], std::log(v), std::atan2(vy, vx), pass.alpha};
    return true;
}

}  // namespace trackfield::passes
