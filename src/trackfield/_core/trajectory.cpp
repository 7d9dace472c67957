// Python's door to the fit of a straight pass to amplitudes.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "trajectory.hpp"

namespace nb = nanobind;
using namespace trackfield::trajectory;

using InTable = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using InVector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using InCounts = nb::ndarray<const int64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

template <class T, size_t N>
static nb::object array(T *data, const size_t (&shape)[N]) {
    nb::capsule owner(data, [](void *p) noexcept { delete[] static_cast<T *>(p); });
    return nb::cast(nb::ndarray<nb::numpy, T>(data, N, shape, owner));
}

// Fit from every start (b, 6). `sensors` (k, 7): x, y, exponent, sigma, saturation, clock sigma, fading (0, 1);
// samples (n,) stand sensor after sensor, those of sensor i from bounds[i] to bounds[i + 1].
static nb::tuple fit(InTable starts, InTable sensors, InCounts bounds, InVector t_s, InVector values, bool free_exponent, int most, double done) {
    const size_t b = starts.shape(0), k = sensors.shape(0), n = t_s.shape(0);
    if (starts.shape(1) != kMost || sensors.shape(1) != 7 || bounds.shape(0) != k + 1 || values.shape(0) != n)
        throw nb::value_error("starts (b, 6), sensors (k, 7), bounds (k + 1,), times and values (n,) expected");
    Samples given{{}, t_s.data(), values.data(), free_exponent ? kMost : kMost - 1};
    for (size_t i = 0; i < k; ++i) {
        const double *s = sensors.data() + 7 * i;
        const int64_t first = bounds.data()[i], last = bounds.data()[i + 1];
        if (first < 0 || last < first || size_t(last) > n) throw nb::value_error("bounds that rise from 0 to n expected");
        given.sensors.push_back({s[0], s[1], s[2], s[3], s[4], s[5], s[6] != 0.0, size_t(first), size_t(last)});
    }
    const size_t p = size_t(given.free);
    double *unknowns = new double[b * kMost + 1], *clocks = new double[b * k + 1], *costs = new double[b * k + 1], *information = new double[b * p * p + 1];
    int32_t *iterations = new int32_t[b + 1];
    bool *converged = new bool[b + 1];
    {
        nb::gil_scoped_release release;
        for (size_t r = 0; r < b; ++r) {
            Unknowns start;
            std::copy_n(starts.data() + kMost * r, kMost, start.begin());
            const Fit found = descend(given, start, most, done);
            std::copy(found.at.u.begin(), found.at.u.end(), unknowns + kMost * r);
            std::copy(found.at.clock.begin(), found.at.clock.end(), clocks + k * r);
            std::copy(found.end.cost.begin(), found.end.cost.end(), costs + k * r);
            double H[kMost][kMost], g[kMost];
            reduce(given, found.end, 0.0, H, g);
            for (size_t i = 0; i < p; ++i)
                for (size_t j = 0; j < p; ++j) information[(r * p + i) * p + j] = H[std::max(i, j)][std::min(i, j)];
            iterations[r] = found.iterations, converged[r] = found.converged;
        }
    }
    return nb::make_tuple(array<double, 2>(unknowns, {b, size_t(kMost)}), array<double, 2>(clocks, {b, k}), array<double, 2>(costs, {b, k}), array<double, 3>(information, {b, p, p}), array<int32_t, 1>(iterations, {b}), array<bool, 1>(converged, {b}));
}

NB_MODULE(_trajectory, m) { m.def("fit", &fit); }
