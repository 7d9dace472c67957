// Kalman belief of one target in the plane, x y and their velocities, after reports of its position.
//
// `Round` serves reports whose covariance is a circle: one 2 x 2 covariance holds for both axes.
// `Oblique` serves any covariance. Both have the same members, so the sampler is written once.
#pragma once

#include <cmath>
#include <cstdint>

namespace trackfield::mcmcda {

constexpr double kTwoPi = 6.283185307179586;

// One report: where, how surely, in which slot of the window.
struct Report {
    double x, y, xx, xy, yy;  // covariance [m^2]
    int32_t slot;
};

// Motion from one slot to a later one: x' = F x + w, w with the accumulated covariance per axis.
struct Gap {
    double dt, pp, pv, vv;
};

struct Round {
    double x, y, u, v;  // position, velocity
    double pp, pv, vv;  // covariance of either axis

    static Round first(const Report &r, double velocity_variance) {
        return {r.x, r.y, 0, 0, r.xx, 0, velocity_variance};
    }

    void predict(const Gap &g) {
        x += g.dt * u;
        y += g.dt * v;
        pp += g.dt * (2 * pv + g.dt * vv) + g.pp;
        pv += g.dt * vv + g.pv;
        vv += g.vv;
    }

    // Twice the exponent, and the norm, of the density of `r` a gap later; no update.
    double distance2(const Report &r, const Gap &g, double &norm) const {
        const double ex = r.x - x - g.dt * u, ey = r.y - y - g.dt * v;
        const double S = pp + g.dt * (2 * pv + g.dt * vv) + g.pp + r.xx;
        norm = kTwoPi * S;
        return (ex * ex + ey * ey) / S;
    }

    // Condition on `r`; log density of `r`.
    double update(const Report &r) {
        const double ex = r.x - x, ey = r.y - y, inverse = 1 / (pp + r.xx);
        const double k = pp * inverse, l = pv * inverse;
        x += k * ex;
        y += k * ey;
        u += l * ex;
        v += l * ey;
        vv -= l * pv;
        pv = r.xx * l;
        pp = r.xx * k;
        return -0.5 * (ex * ex + ey * ey) * inverse + std::log(inverse * (1 / kTwoPi));
    }

    // Standard deviation of either coordinate.
    double sigma_x() const { return std::sqrt(pp); }
    double sigma_y() const { return std::sqrt(pp); }
};

struct Oblique {
    double x, y, u, v;
    double xx, xy, yy;          // of the position
    double xu, xv, yu, yv;      // position against velocity
    double uu, uv, vv;          // of the velocity

    static Oblique first(const Report &r, double velocity_variance) {
        return {r.x, r.y, 0, 0, r.xx, r.xy, r.yy, 0, 0, 0, 0, velocity_variance, 0, velocity_variance};
    }

    void predict(const Gap &g) {
        const double t = g.dt;
        x += t * u;
        y += t * v;
        xx += t * (2 * xu + t * uu) + g.pp;
        xy += t * (xv + yu + t * uv);
        yy += t * (2 * yv + t * vv) + g.pp;
        xu += t * uu + g.pv;
        xv += t * uv;
        yu += t * uv;
        yv += t * vv + g.pv;
        uu += g.vv;
        vv += g.vv;
    }

    double distance2(const Report &r, const Gap &g, double &norm) const {
        const double t = g.dt, ex = r.x - x - t * u, ey = r.y - y - t * v;
        const double a = xx + t * (2 * xu + t * uu) + g.pp + r.xx, b = xy + t * (xv + yu + t * uv) + r.xy;
        const double c = yy + t * (2 * yv + t * vv) + g.pp + r.yy, det = a * c - b * b;
        norm = kTwoPi * std::sqrt(det);
        return (c * ex * ex - 2 * b * ex * ey + a * ey * ey) / det;
    }

    double update(const Report &r) {
        const double ex = r.x - x, ey = r.y - y;
        const double a = xx + r.xx, b = xy + r.xy, c = yy + r.yy, det = a * c - b * b;
        const double ia = c / det, ib = -b / det, ic = a / det;  // inverse of S
        const double from[4][2] = {{xx, xy}, {xy, yy}, {xu, yu}, {xv, yv}};  // P H'
        double gain[4][2];
        for (int i = 0; i < 4; ++i) {
            gain[i][0] = from[i][0] * ia + from[i][1] * ib;
            gain[i][1] = from[i][0] * ib + from[i][1] * ic;
        }
        const auto taken = [&](int i, int j) { return gain[i][0] * from[j][0] + gain[i][1] * from[j][1]; };
        x += gain[0][0] * ex + gain[0][1] * ey;
        y += gain[1][0] * ex + gain[1][1] * ey;
        u += gain[2][0] * ex + gain[2][1] * ey;
        v += gain[3][0] * ex + gain[3][1] * ey;
        uu -= taken(2, 2);
        uv -= taken(2, 3);
        vv -= taken(3, 3);
        xu -= taken(0, 2);
        xv -= taken(0, 3);
        yu -= taken(1, 2);
        yv -= taken(1, 3);
        xx -= taken(0, 0);
        xy -= taken(0, 1);
        yy -= taken(1, 1);
        return -0.5 * (ia * ex * ex + 2 * ib * ex * ey + ic * ey * ey) - std::log(kTwoPi * std::sqrt(det));
    }

    double sigma_x() const { return std::sqrt(xx); }
    double sigma_y() const { return std::sqrt(yy); }
};

}  // namespace trackfield::mcmcda
