// What one sensor of bearings, angular rates or motion says of a state, and its slope.
#pragma once

#include <cmath>

namespace trackfield::angles {

constexpr int kMost = 6;          // numbers of a state: position, then velocity
constexpr double kCore = 1e-6;    // nearer to a sensor than this there is no direction [m]
constexpr double kTurn = 6.283185307179586476925;

enum Says { kBearing = 0, kRate = 1, kMotion = 2 };

// A row of a scan: who says what. In the plane motion has a sign that its sensor does not tell.
struct Look {
    int says;
    double place[3], velocity[3];
    double sigma, bias, falloff, threshold, reach;
    double value;
    double alive;  // of a sensor that kept silent: the chance that it works; NaN of one that spoke
    bool silent() const { return !std::isnan(alive); }
};

inline double wrapped(double angle) { return angle - kTurn * std::floor((angle + 0.5 * kTurn) / kTurn); }

struct Offset {
    double x[3], v[3];  // of the target, seen from the sensor
    bool plane;
};

inline Offset offset_of(const Look &look, const double *state, int d) {
    Offset o;
    for (int k = 0; k < 3; ++k) {
        o.x[k] = (k < d ? state[k] : 0.0) - look.place[k];
        o.v[k] = (k < d ? state[d + k] : 0.0) - look.velocity[k];
    }
    o.plane = d == 2 && o.x[2] == 0.0 && o.v[2] == 0.0;
    return o;
}

// Whether a reading of the look has a sign that is not told.
inline bool unsigned_in_plane(const Look &look, const double *state, int d) {
    return look.says == kMotion && offset_of(look, state, d).plane;
}

// Expected value at `state` (2 d,), bearings by the turn nearest to the reading; its slope (2 d,).
inline double expected(const Look &look, const double *state, int d, double *slope) {
    const Offset o = offset_of(look, state, d);
    const double *x = o.x, *v = o.v;
    for (int k = 0; k < 2 * d; ++k) slope[k] = 0.0;
    const double flat = x[0] * x[0] + x[1] * x[1];
    const double inverse = flat < kCore * kCore ? 0.0 : 1.0 / flat;
    if (look.says == kBearing) {
        slope[0] = -x[1] * inverse;
        slope[1] = x[0] * inverse;
        return look.value - wrapped(look.value - (std::atan2(x[1], x[0]) + look.bias));
    }
    if (look.says == kRate || o.plane) {
        const double fall = look.says == kRate ? 1.0 : look.falloff;
        const double scale = fall == 1.0 ? inverse : inverse > 0 ? std::pow(inverse, 0.5 * (fall + 1.0)) : 0.0;
        const double h = (x[0] * v[1] - x[1] * v[0]) * scale;
        slope[0] = v[1] * scale - (fall + 1.0) * h * x[0] * inverse;
        slope[1] = -v[0] * scale - (fall + 1.0) * h * x[1] * inverse;
        slope[d] = -x[1] * scale;
        slope[d + 1] = x[0] * scale;
        return h;
    }
    // Size of the motion across the line of sight, in space: w = v - (v.u) u.
    const double r = std::sqrt(flat + x[2] * x[2]);
    if (r < kCore) return 0.0;
    double along = 0, w[3], square = 0;
    for (int k = 0; k < 3; ++k) along += v[k] * x[k] / r;
    for (int k = 0; k < 3; ++k) w[k] = v[k] - along * x[k] / r, square += w[k] * w[k];
    const double speed = std::sqrt(square), scale = std::pow(r, -look.falloff);
    for (int k = 0; k < d; ++k) {
        const double e = w[k] / std::fmax(speed, 1e-12);
        slope[k] = -scale / r * (along * e + look.falloff * speed * x[k] / r);
        slope[d + k] = scale * e;
    }
    return scale * speed;
}

}  // namespace trackfield::angles
