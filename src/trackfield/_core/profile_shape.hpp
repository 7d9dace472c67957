// The amplitude of a straight pass: A (1 + c tau^2)^(-alpha / 2), tau = (t - tm) / D, and its slopes.
#pragma once

#include <cmath>

namespace trackfield::profiles {

struct Shape {
    double alpha = 1, c = 3;
    explicit Shape(double exponent) : alpha(exponent), c(std::exp2(2.0 / exponent) - 1.0) {}

    // q^(-alpha / 2) of q = 1 + c tau^2; the exponents of free space and of energies need no logarithm.
    double falloff(double q) const {
        if (alpha == 1.0) return 1.0 / std::sqrt(q);
        if (alpha == 2.0) return 1.0 / q;
        return std::exp(-0.5 * alpha * std::log(q));
    }
    double at(double tau) const { return falloff(1.0 + c * tau * tau); }
};

struct Numbers {
    double a = 0, tm = 0, width = 0;
};

}  // namespace trackfield::profiles
