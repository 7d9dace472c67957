// What readings leave unknown: covariance, free directions, and the value of a criterion.
#pragma once

#include <vector>

#include "selection_merit.hpp"

namespace trackfield::selection {

constexpr double kUnknownVariance = 1e12, kFlat = 1e-12;  // as in trackfield.linalg

template <int D>
struct Left {
    Packed<D> covariance;
    std::vector<double> missing;  // directions, one after the other
    double value = 0;             // A: the trace, the less the better; D, E as merits

    Left(const Packed<D> &information, Criterion criterion) {
        const Spectrum<D> spectrum(information);
        const double floor = std::max(kFlat * spectrum.largest(), 1.0 / kUnknownVariance);
        std::array<double, D> variances{};
        double least = INFINITY, sum = 0, logs = 0;
        for (int a = 0; a < D; ++a) {
            const double root = std::max(spectrum.roots[a], floor);
            variances[a] = 1.0 / root;
            sum += variances[a];
            logs += std::log(root);
            least = std::min(least, root);
            if (spectrum.roots[a] > floor) continue;
            for (int i = 0; i < D; ++i) missing.push_back(spectrum.axes[i * D + a]);
        }
        covariance = spectrum.with(variances);
        value = criterion == Criterion::kTrace ? sum : criterion == Criterion::kDeterminant ? logs : least;
    }
};

}  // namespace trackfield::selection
