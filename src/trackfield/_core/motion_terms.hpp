// What bearings, angular rates and motion rates of one time or window say of a target that keeps its
// velocity: half the squared misfit, and its slopes in the state at time 0. The units are those of the
// state.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>

namespace trackfield::motion {

enum Kind : int32_t { bearing = 0, rate = 1, size = 2 };  // as in localization/motion_readings.py

constexpr double kCore2 = 1e-12;  // nearer to a sensor than a micrometre there is no line of sight [m^2]

struct Readings {
    size_t n = 0;
    const double *t = nullptr;       // [s] from the time of the state
    const double *sensor = nullptr;  // (n, d) [m], at the time of its reading
    const double *drift = nullptr;   // (n, d) [m/s], the sensor's own velocity
    const double *value = nullptr, *sigma = nullptr, *falloff = nullptr;
    const int32_t *kind = nullptr;
};

template <int d>
struct Terms {
    double cost = 0;
    double gradient[2 * d] = {};
    double curvature[2 * d][2 * d] = {};  // Gauss-Newton
};

// Expected reading, and its slopes in place and velocity of the target seen from the sensor.
template <int d>
struct Seen {
    double value = 0;
    double place[d] = {}, velocity[d] = {};
};

// Bearings and rates are of the plane of the first two axes.
template <int d>
inline Seen<d> see_bearing(const double *o) {
    Seen<d> s;
    const double r2 = o[0] * o[0] + o[1] * o[1];
    if (r2 < kCore2) return s;
    s.value = std::atan2(o[1], o[0]);
    s.place[0] = -o[1] / r2;
    s.place[1] = o[0] / r2;
    return s;
}

template <int d>
inline Seen<d> see_rate(const double *o, const double *u) {
    Seen<d> s;
    const double r2 = o[0] * o[0] + o[1] * o[1];
    if (r2 < kCore2) return s;
    const double scale = 1.0 / r2;
    s.value = (o[0] * u[1] - o[1] * u[0]) * scale;
    const double fall = 2.0 * s.value * scale;
    s.place[0] = u[1] * scale - fall * o[0];
    s.place[1] = -u[0] * scale - fall * o[1];
    s.velocity[0] = -o[1] * scale;
    s.velocity[1] = o[0] * scale;
    return s;
}

// The part of the velocity across the line of sight over r^p.
template <int d>
inline Seen<d> see_size(const double *o, const double *u, double p) {
    Seen<d> s;
    double r2 = 0, along = 0, u2 = 0;
    for (int k = 0; k < d; ++k) r2 += o[k] * o[k], along += o[k] * u[k], u2 += u[k] * u[k];
    if (r2 < kCore2) return s;
    along /= r2;
    double across[d], w2 = 0;
    for (int k = 0; k < d; ++k) across[k] = u[k] - along * o[k], w2 += across[k] * across[k];
    if (w2 <= 1e-24 * u2) return s;  // only rounding is left: here the size has a kink
    const double w = std::sqrt(w2), scale = p == 1.0 ? 1.0 / std::sqrt(r2) : std::pow(r2, -0.5 * p);
    s.value = w * scale;
    for (int k = 0; k < d; ++k) {
        const double steep = across[k] / w * scale;
        s.place[k] = -along * steep - p * s.value * o[k] / r2;
        s.velocity[k] = steep;
    }
    return s;
}

template <int d>
inline Seen<d> see(int32_t kind, const double *o, const double *u, double p) {
    if (kind == bearing) return see_bearing<d>(o);
    return kind == rate ? see_rate<d>(o, u) : see_size<d>(o, u, p);
}

inline double misfit(int32_t kind, double difference) {
    constexpr double kTurn = 6.283185307179586476925287;
    return kind == bearing ? std::remainder(difference, kTurn) : difference;
}

// Misfit of reading i in standard deviations.
template <int d>
inline double residual(const Readings &z, size_t i, const double *state, Seen<d> &s) {
    double o[d], u[d];
    for (int k = 0; k < d; ++k) {
        o[k] = state[k] + z.t[i] * state[d + k] - z.sensor[i * d + k];
        u[k] = state[d + k] - z.drift[i * d + k];
    }
    s = see<d>(z.kind[i], o, u, z.falloff[i]);
    return misfit(z.kind[i], z.value[i] - s.value) / z.sigma[i];
}

template <int d>
inline double cost(const Readings &z, const double *state) {
    double sum = 0;
    Seen<d> s;
    for (size_t i = 0; i < z.n; ++i) {
        const double e = residual<d>(z, i, state, s);
        sum += e * e;
    }
    return 0.5 * sum;
}

template <int d>
inline void terms(const Readings &z, const double *state, Terms<d> &out) {
    out = Terms<d>();
    Seen<d> s;
    double sum = 0;
    for (size_t i = 0; i < z.n; ++i) {
        const double e = residual<d>(z, i, state, s);
        double row[2 * d];
        for (int k = 0; k < d; ++k) {
            row[k] = s.place[k] / z.sigma[i];
            row[d + k] = (z.t[i] * s.place[k] + s.velocity[k]) / z.sigma[i];
        }
        sum += e * e;
        for (int a = 0; a < 2 * d; ++a) {
            out.gradient[a] -= row[a] * e;
            for (int b = 0; b <= a; ++b) out.curvature[a][b] += row[a] * row[b];
        }
    }
    out.cost = 0.5 * sum;
}

}  // namespace trackfield::motion
