// Which reports of a scan can be used: one pass, since every step needs it.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "bernoulli_model.hpp"

namespace trackfield {

enum class Fault { kNone, kPosition, kNumber, kCovariance };

struct Intake {
    Fault fault = Fault::kNone;
    std::vector<uint8_t> keep;
    int64_t outside = 0, duplicate = 0;
};

// `known` are places of reports of the same scan that came before.
inline Intake take_in(const double *position, const double *covariance, const int32_t *number, size_t n, const Rect &region,
                      double variance, const double *known, size_t m) {
    constexpr double kFar2 = 25;  // 5 sigmas outside the region: no error of a report brings one there
    Intake in;
    in.keep.assign(n, 1);
    std::vector<std::pair<std::pair<double, double>, size_t>> places;
    places.reserve(n + m);
    for (size_t i = 0; i < m; ++i) places.push_back({{known[2 * i], known[2 * i + 1]}, i});
    for (size_t i = 0; i < n; ++i) {
        const double x = position[2 * i], y = position[2 * i + 1], *R = covariance + 3 * i;
        if (!std::isfinite(x) || !std::isfinite(y)) in.fault = Fault::kPosition;
        if (number[i] < 0) in.fault = Fault::kNumber;
        const bool told = !(std::isnan(R[0]) && std::isnan(R[1]) && std::isnan(R[2]));
        if (told && !(R[0] > 0 && R[2] > 0 && R[0] * R[2] > R[1] * R[1] && R[0] < 1e18 && R[2] < 1e18)) in.fault = Fault::kCovariance;
        if (in.fault != Fault::kNone) return in;
        const double far_x = std::sqrt(kFar2 * (told ? R[0] : variance)), far_y = std::sqrt(kFar2 * (told ? R[2] : variance));
        if (x < region.x_min - far_x || x > region.x_max + far_x || y < region.y_min - far_y || y > region.y_max + far_y) {
            in.keep[i] = 0;
            ++in.outside;
            continue;
        }
        places.push_back({{x, y}, m + i});
    }
    std::sort(places.begin(), places.end());
    for (size_t k = 1; k < places.size(); ++k)
        if (places[k].first == places[k - 1].first && places[k].second >= m) {
            in.keep[places[k].second - m] = 0;
            ++in.duplicate;
        }
    return in;
}

}  // namespace trackfield
