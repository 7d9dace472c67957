// Python's door to shortest paths through discs.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "touring.hpp"

namespace nb = nanobind;
using namespace trackfield;

using In = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using InMatrix = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

// Path (n, 2), its length, a lower bound of every path's, Newton steps, and whether they met.
static nb::tuple tour(In start, InMatrix centres, In radii, double gap, int most) {
    const size_t n = radii.shape(0);
    if (start.shape(0) != 2 || centres.shape(0) != n || centres.shape(1) != 2 || n == 0)
        throw nb::value_error("start (2,), centres (n, 2) and radii (n,) expected, n > 0");
    std::vector<Vec2> places(n);
    for (size_t k = 0; k < n; ++k) places[k] = {centres.data()[2 * k], centres.data()[2 * k + 1]};
    Touring found({start.data()[0], start.data()[1]}, std::move(places), {radii.data(), radii.data() + n});
    const bool met = found.solve(gap, most);
    double *path = new double[2 * n];
    for (size_t k = 0; k < n; ++k) path[2 * k] = found.x[k].x, path[2 * k + 1] = found.x[k].y;
    nb::capsule owner(path, [](void *p) noexcept { delete[] static_cast<double *>(p); });
    size_t shape[2] = {n, 2};
    return nb::make_tuple(nb::cast(nb::ndarray<nb::numpy, double>(path, 2, shape, owner)), found.length, found.bound,
                          found.steps, met);
}

NB_MODULE(_touring, m) { m.def("tour", &tour); }
