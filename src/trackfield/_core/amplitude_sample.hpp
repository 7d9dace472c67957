// What one sample of an amplitude says of its mean: cost, slope and expected curvature.
#pragma once

#include <algorithm>
#include <cmath>

namespace trackfield::profiles {

constexpr double kLogRoot2Pi = 0.91893853320467274178;
constexpr double kTail = 25.0;  // from here on the normal law's tail is its asymptote

// log of the upper tail of the normal law at z, and density over tail.
inline double log_tail(double z) {
    if (z > kTail) return -0.5 * z * z - kLogRoot2Pi - std::log(z);
    return std::log(0.5 * std::erfc(z * 0.70710678118654752440));
}
inline double hazard(double z) {
    if (z > kTail) return z + 1.0 / z;
    return std::exp(-0.5 * z * z - kLogRoot2Pi - log_tail(z));
}

struct Noise {
    double sigma = 1, saturation = INFINITY;
    bool rayleigh = false;
};

// Negative log-likelihood; its first and second slope in the mean; what the second is in the mean.
struct Sample {
    double cost = 0, slope = 0, second = 0, expected = 0;
};

// Of a value r for the mean a >= 0, without fading; a value at the saturation says "at least this".
inline Sample plain_sample(const Noise &noise, double r, double a) {
    const double z = (r - a) / noise.sigma, per = 1.0 / (noise.sigma * noise.sigma);
    if (std::isinf(noise.saturation)) return {0.5 * z * z, -z / noise.sigma, per, per};
    const double u = std::min((noise.saturation - a) / noise.sigma, 40.0);
    const double density = std::exp(-0.5 * u * u - kLogRoot2Pi);
    const double told = 0.5 * std::erfc(-u * 0.70710678118654752440) + density * (hazard(u) - u);
    const double expected = std::clamp(told, 0.0, 1.0) * per;
    if (r < noise.saturation) return {0.5 * z * z, -z / noise.sigma, per, expected};
    const double h = hazard(z), constant = std::log(noise.sigma) + kLogRoot2Pi;
    return {-log_tail(z) - constant, -h / noise.sigma, h * (h - z) * per, expected};
}

// With fading: x = v / N0 is the energy's mean in units of the noise's; the cost is without log x,
// which those that do not stand at the saturation add.
inline Sample faded_sample(const Noise &noise, double r, double a, double x) {
    const double v = noise.sigma * noise.sigma * x, q = r * r / v, w = 2.0 * a / v;
    const double clear = r < noise.saturation ? 1.0 : 0.0;
    const double hidden = std::isinf(noise.saturation) ? 0.0 : std::exp(-noise.saturation * noise.saturation / v);
    const double second = 2.0 / v * (clear - q) + w * w * (2.0 * q - clear);
    return {q, w * (clear - q), second, w * w * (1.0 - hidden)};
}

// A sum of logarithms of numbers of 1 or more, with few logarithms.
struct LogSum {
    double logs = 0, product = 1;
    void add(double x) {
        product *= x;
        if (product > 1e150) logs += std::log(product), product = 1;
    }
    double total() const { return logs + std::log(product); }
};

}  // namespace trackfield::profiles
