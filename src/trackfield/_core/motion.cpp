// Python's door to the fits of targets that keep their velocity, to readings of angles and motion.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <algorithm>
#include <vector>

#include "motion_descent.hpp"

namespace nb = nanobind;
using namespace trackfield::motion;

using In = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using InMatrix = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using InKinds = nb::ndarray<const int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

static nb::object array(const std::vector<double> &values, size_t columns) {
    double *data = new double[values.size() + 1];
    std::copy(values.begin(), values.end(), data);
    nb::capsule owner(data, [](void *p) noexcept { delete[] static_cast<double *>(p); });
    size_t shape[2] = {values.size() / columns, columns};
    return nb::cast(nb::ndarray<nb::numpy, double>(data, 2, shape, owner));
}

static Readings readings(const In &t, const InMatrix &sensor, const InMatrix &drift, const InMatrix &columns, const InKinds &kind) {
    Readings z;
    z.n = t.shape(0);
    const size_t d = sensor.shape(1);
    const bool fits = (d == 2 || d == 3) && sensor.shape(0) == z.n && drift.shape(0) == z.n && drift.shape(1) == d &&
                      columns.shape(0) == 3 && columns.shape(1) == z.n && kind.shape(0) == z.n;
    if (!fits) throw nb::value_error("readings as columns of one length expected");
    z.t = t.data();
    z.sensor = sensor.data();
    z.drift = drift.data();
    z.value = columns.data();
    z.sigma = columns.data() + z.n;
    z.falloff = columns.data() + 2 * z.n;
    z.kind = kind.data();
    return z;
}

// Columns of the answer: state, cost, iterations, converged.
template <int d>
static std::vector<double> descend_all(const Readings &z, const InMatrix &starts, const double *centre, double reach, int iterations) {
    std::vector<double> out;
    for (size_t b = 0; b < starts.shape(0); ++b) {
        const Descent<d> one = descend<d>(z, starts.data() + b * 2 * d, centre, reach, iterations);
        out.insert(out.end(), one.state, one.state + 2 * d);
        out.insert(out.end(), {one.at.cost, double(one.iterations), double(one.converged)});
    }
    return out;
}

template <int d>
static std::vector<double> costs_all(const Readings &z, const InMatrix &states) {
    std::vector<double> out(states.shape(0));
    for (size_t b = 0; b < out.size(); ++b) out[b] = cost<d>(z, states.data() + b * 2 * d);
    return out;
}

static nb::object descend_from(In t, InMatrix sensor, InMatrix drift, InMatrix columns, InKinds kind, InMatrix starts, In centre, double reach, int iterations) {
    const Readings z = readings(t, sensor, drift, columns, kind);
    const size_t d = sensor.shape(1);
    if (starts.shape(1) != 2 * d || centre.shape(0) != d) throw nb::value_error("starts (B, 2 d) and a centre (d,) expected");
    std::vector<double> out;
    {
        nb::gil_scoped_release release;
        out = d == 2 ? descend_all<2>(z, starts, centre.data(), reach, iterations) : descend_all<3>(z, starts, centre.data(), reach, iterations);
    }
    return array(out, 2 * d + 3);
}

static nb::object costs(In t, InMatrix sensor, InMatrix drift, InMatrix columns, InKinds kind, InMatrix states) {
    const Readings z = readings(t, sensor, drift, columns, kind);
    const size_t d = sensor.shape(1);
    if (states.shape(1) != 2 * d) throw nb::value_error("states (B, 2 d) expected");
    std::vector<double> out;
    {
        nb::gil_scoped_release release;
        out = d == 2 ? costs_all<2>(z, states) : costs_all<3>(z, states);
    }
    return array(out, 1);
}

NB_MODULE(_motion, m) {
    m.def("descend", &descend_from);
    m.def("costs", &costs);
}
