// Readings that do not say all: a size without its sign, and silence. Each becomes a plain reading
// with the moments of what it leaves of the prediction.
#pragma once

#include <limits>

#include "angle_looks.hpp"

namespace trackfield::angles {

// A reading `z` of variance `R`; an infinite one says nothing. `chance`: of the silence, if working.
struct Evidence {
    double z, R;
    double chance = 1.0;
};

// A reading z = |y| with y ~ N(mean, S): y = +-z, whichever sign the prediction makes likelier.
inline Evidence of_size(double z, double mean, double S, double R) {
    const double sign = std::tanh(mean * z / S);
    return {sign * z, R + (1.0 - sign * sign) * z * z};
}

// Silence: -T < y < T, said with the chance that the sensor works. Moments of the mixture of y cut
// off there and y as it was: a reading that leaves the mean m and the variance v of N(mean, S) has
// variance R + S v/(S - v) and value mean + (m - mean) S/(S - v).
inline Evidence of_silence(double least, double most, double mean, double S, double R, double alive) {
    const double s = std::sqrt(S), a = (least - mean) / s, b = (most - mean) / s;
    const auto density = [](double u) { return 0.3989422804014327 * std::exp(-0.5 * u * u); };
    const auto below = [](double u) { return 0.5 * std::erfc(-u * 0.7071067811865476); };
    // On the side where both are small, so that their difference is exact.
    const double chance = a > 0 ? below(-a) - below(-b) : below(b) - below(a);
    const double none = std::numeric_limits<double>::infinity();
    const double total = alive * chance + 1.0 - alive;
    if (chance < 1e-12 || total <= 0) return {mean, none, chance};
    const double shift = (density(a) - density(b)) / chance;
    const double bent = (std::isfinite(a) ? a * density(a) : 0.0) - (std::isfinite(b) ? b * density(b) : 0.0);
    const double cut_mean = s * shift, cut = S * (1.0 + bent / chance - shift * shift);
    const double w = alive * chance / total;
    const double m = w * cut_mean, v = w * cut + (1.0 - w) * S + w * (1.0 - w) * cut_mean * cut_mean;
    if (!(v < S * (1.0 - 1e-9))) return {mean, none, chance};
    return {mean + m * S / (S - v), R + S * v / (S - v), chance};
}

}  // namespace trackfield::angles
