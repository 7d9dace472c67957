// Python's door to the cheapest sets of sensors that meet a bound.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "soft_sets.hpp"

namespace nb = nanobind;
using namespace trackfield::soft;

using InStack = nb::ndarray<const double, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using InTable = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using InVector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

template <class T, size_t N>
static nb::object array(T *data, const size_t (&shape)[N]) {
    nb::capsule owner(data, [](void *p) noexcept { delete[] static_cast<T *>(p); });
    return nb::cast(nb::ndarray<nb::numpy, T>(data, N, shape, owner));
}

template <int D>
static void search(const InStack &priors, const InStack &gains, const InTable &prices, const InVector &bounds, const InVector &worths, int fewest, int most, int32_t *sensors, double *price, double *trace) {
    const size_t n = gains.shape(1);
    for (size_t r = 0; r < gains.shape(0); ++r) {
        Search<D> of(bounds.data()[r], worths.data()[r]);
        const Set set = of.best(priors.data() + r * D * D, gains.data() + r * n * D, prices.data() + r * n, int(n), fewest, most);
        std::copy(set.sensor, set.sensor + 3, sensors + 3 * r);
        price[r] = set.price, trace[r] = set.trace;
    }
}

static nb::tuple cheapest(InStack priors, InStack gains, InTable prices, InVector bounds, InVector worths, int fewest, int most) {
    const size_t s = gains.shape(0), n = gains.shape(1), d = gains.shape(2);
    if (priors.shape(0) != s || priors.shape(1) != d || priors.shape(2) != d || prices.shape(0) != s || prices.shape(1) != n || bounds.shape(0) != s || worths.shape(0) != s)
        throw nb::value_error("priors (s, d, d), gains (s, n, d), prices (s, n), bounds and worths (s,) expected");
    if (d != 2 && d != 3) throw nb::value_error("2 or 3 dimensions expected");
    if (fewest < 0 || most > 3 || fewest > most) throw nb::value_error("0 <= fewest <= most <= 3 expected");
    int32_t *sensors = new int32_t[3 * s + 1];
    double *price = new double[s + 1], *trace = new double[s + 1];
    {
        nb::gil_scoped_release release;
        d == 2 ? search<2>(priors, gains, prices, bounds, worths, fewest, most, sensors, price, trace) : search<3>(priors, gains, prices, bounds, worths, fewest, most, sensors, price, trace);
    }
    return nb::make_tuple(array<int32_t, 2>(sensors, {s, 3}), array<double, 1>(price, {s}), array<double, 1>(trace, {s}));
}

NB_MODULE(_soft, m) { m.def("cheapest", &cheapest); }
