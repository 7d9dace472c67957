// Python's door to passes of a target from energy messages.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "passes_modes.hpp"

namespace nb = nanobind;
using namespace trackfield::passes;

using InStack = nb::ndarray<const double, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using InTable = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

template <class T, size_t N>
static nb::object array(T *data, const size_t (&shape)[N]) {
    nb::capsule owner(data, [](void *p) noexcept { delete[] static_cast<T *>(p); });
    return nb::cast(nb::ndarray<nb::numpy, T>(data, N, shape, owner));
}

// The units in which a problem is of order one: the field's middle and radius, the time and width of its sharpest message.
struct Scale {
    double x = 0.0, y = 0.0, length = 0.0, time = 0.0, span = 1.0;
};

static Scale scale(const InTable &sensors, const InTable &numbers, const InTable &records) {
    Scale of;
    const size_t n = sensors.shape(0);
    for (size_t k = 0; k < n; ++k) of.x += sensors(k, 0) / double(n), of.y += sensors(k, 1) / double(n);
    for (size_t k = 0; k < n; ++k) of.length += (std::pow(sensors(k, 0) - of.x, 2) + std::pow(sensors(k, 1) - of.y, 2)) / double(n);
    of.length = of.length > 0.0 ? std::sqrt(of.length) : 1.0;
    double sharpest = 0.0;
    for (size_t k = 0; k < n; ++k) {
        const double a = numbers(k, 0) / records(k, 3), width = numbers(k, 2);
        if (a > 0.0 && width > 0.0 && !(a * a / width <= sharpest)) sharpest = a * a / width, of.time = numbers(k, 1);
    }
    double widths = 0.0, heard = 0.0;
    for (size_t k = 0; k < n; ++k)
        if (numbers(k, 0) > 0.0 && numbers(k, 2) > 0.0) widths += std::log(numbers(k, 2)), heard += 1.0;
    if (heard > 0.0) of.span = std::exp(widths / heard);
    return of;
}

// `records` (n, 7): first time, step, count, sigma, clock, fading, saturation; `fishers` (n, 3, 3) as printed, or (0, 3, 3);
// `roundings` (n, 3, 3), covariances of the numbers as coded, or (0, 3, 3).
// Modes: states (m, 6), covariances (m, 6, 6), (m, 4) of half deviance, weight, converged, whether all is fixed; half deviance of each message
// under each mode (m, n) and clock errors (m, n); the deviance of no target (n,); the time at which the places are.
static nb::tuple modes_of(InTable sensors, InTable numbers, InTable records, InStack fishers, InStack roundings, double exponent, double exponent_sigma, int pairs_of, int searched) {
    const size_t n = sensors.shape(0);
    if (n == 0 || sensors.shape(1) != 2 || numbers.shape(0) != n || numbers.shape(1) != 3 || records.shape(0) != n || records.shape(1) != 7)
        throw nb::value_error("sensors (n, 2), numbers (n, 3), records (n, 7) expected, n > 0");
    const Scale unit = scale(sensors, numbers, records);
    const bool printed = fishers.shape(0) > 0;
    if (printed && (fishers.shape(0) != n || fishers.shape(1) != 3 || fishers.shape(2) != 3)) throw nb::value_error("fishers (n, 3, 3) expected");
    const bool rounded = roundings.shape(0) > 0;
    if (rounded && (roundings.shape(0) != n || roundings.shape(1) != 3 || roundings.shape(2) != 3)) throw nb::value_error("roundings (n, 3, 3) expected");
    Pass pass;
    pass.alpha = exponent;
    if (exponent_sigma > 0.0) pass.n = STATES, pass.alpha_weight = 1.0 / (exponent_sigma * exponent_sigma);
    pass.messages.reserve(n);
    for (size_t k = 0; k < n; ++k) {
        const double psi[3] = {numbers(k, 0), (numbers(k, 1) - unit.time) / unit.span, numbers(k, 2) / unit.span};
        const double record[7] = {(records(k, 0) - unit.time) / unit.span, records(k, 1) / unit.span, records(k, 2), records(k, 3), records(k, 4) / unit.span, records(k, 5), records(k, 6)};
        const double per[3] = {1.0, unit.span, unit.span};
        double fisher[9], rounding[9];
        for (int i = 0; printed && i < 9; ++i) fisher[i] = fishers.data()[9 * k + i] * per[i / 3] * per[i % 3];
        for (int i = 0; rounded && i < 9; ++i) rounding[i] = roundings.data()[9 * k + i] / (per[i / 3] * per[i % 3]);
        pass.messages.emplace_back((sensors(k, 0) - unit.x) / unit.length, (sensors(k, 1) - unit.y) / unit.length, psi, record, printed ? fisher : nullptr, rounded ? rounding : nullptr, exponent);
        pass.clocks |= records(k, 4) > 0.0;
    }
    Search search;
    search.pairs_of = pairs_of, search.searched = searched, search.printed = printed;
    std::vector<Mode> found;
    {
        nb::gil_scoped_release release;
        found = modes(pass, search);
    }
    const size_t m = found.size();
    double *loudness = new double[n];
    for (size_t k = 0; k < n; ++k) loudness[k] = pass.messages[k].loudness();
    const double size[STATES] = {1.0, unit.length, unit.length, 1.0, 1.0, 1.0};
    double *states = new double[STATES * m + 1], *covariances = new double[STATES * STATES * m + 1](), *merit = new double[4 * m + 1];
    double *misfit = new double[n * m + 1], *late = new double[n * m + 1];
    for (size_t i = 0; i < m; ++i) {
        const Fit &fit = found[i].fit;
        Square L{};
        double ridge = 0.0;
        while (!factor(fit.F, ridge, pass.n, L) && ridge < 1.0) ridge = std::max(10.0 * ridge, 1e-12);
        if (ridge >= 1.0)  // nothing to be divided by: told as not fixed
            for (int a = 0; a < pass.n; ++a) L[a] = {}, L[a][a] = 1e-3;
        for (int a = 0; a < pass.n; ++a) {
            Column unit{};
            unit[a] = size[a];
            const Column column = solve(L, unit, pass.n);
            for (int b = 0; b < pass.n; ++b) covariances[STATES * (STATES * i + b) + a] = column[b] * size[b];
        }
        for (int a = 0; a < STATES; ++a) states[STATES * i + a] = fit.state[a] * size[a];
        states[STATES * i] += 2.0 * std::log(unit.length);
        states[STATES * i + 1] += unit.x, states[STATES * i + 2] += unit.y;
        states[STATES * i + 3] += std::log(unit.length / unit.span);
        merit[4 * i] = fit.half, merit[4 * i + 1] = std::exp(found[i].log_weight), merit[4 * i + 2] = fit.converged, merit[4 * i + 3] = ridge == 0.0;
        for (size_t k = 0; k < n; ++k) {
            const Quadratic w = Pass::Way(fit.state).from(pass.messages[k], fit.clocks[k]);
            misfit[n * i + k] = pass.messages[k].evidence(w, fit.state[5], pass.n == STATES).half;
            late[n * i + k] = fit.clocks[k] * unit.span;
        }
    }
    return nb::make_tuple(array<double, 2>(states, {m, size_t(STATES)}), array<double, 3>(covariances, {m, size_t(STATES), size_t(STATES)}),
                          array<double, 2>(merit, {m, 4}), array<double, 2>(misfit, {m, n}), array<double, 2>(late, {m, n}), array<double, 1>(loudness, {n}), unit.time);
}

NB_MODULE(_passes, m) { m.def("modes", &modes_of); }
