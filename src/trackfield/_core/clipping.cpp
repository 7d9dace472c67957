// Segments clipped at the half-planes of convex parts: which of them run through one.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace nb = nanobind;

using InMatrix = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using InCube = nb::ndarray<const double, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using Out = nb::ndarray<uint8_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

// A part is where n . x < b for its `planes` half-planes; of a -> a + d the shares 0 < t < 1 with
// over + t slope < 0 for all of them lie in it. It runs through if more than `least` of it does, or all.
static bool runs_through(const double *a, const double *b, const double *normal, const double *limit, size_t planes,
                         double least) {
    double enter = 0, leave = 1;
    for (size_t m = 0; m < planes; ++m, normal += 2) {
        const double over = normal[0] * a[0] + normal[1] * a[1] - limit[m];
        const double slope = normal[0] * (b[0] - a[0]) + normal[1] * (b[1] - a[1]);
        if (slope == 0) {
            if (over >= 0) return false;
        } else if (slope > 0) {
            leave = std::min(leave, -over / slope);
        } else {
            enter = std::max(enter, -over / slope);
        }
        if (enter >= leave) return false;
    }
    return (leave - enter) * std::hypot(b[0] - a[0], b[1] - a[1]) > least || (enter == 0 && leave == 1);
}

// Writes 1 into `out` (s,) where the segment from a (s, 2) to b (s, 2) runs through no part; normals
// (p, m, 2), limits (p, m).
static void clear(InMatrix a, InMatrix b, InCube normals, InMatrix limits, double least, Out out) {
    const size_t segments = a.shape(0), parts = limits.shape(0), planes = limits.shape(1);
    if (b.shape(0) != segments || out.shape(0) != segments || a.shape(1) != 2 || b.shape(1) != 2 ||
        normals.shape(0) != parts || normals.shape(1) != planes || normals.shape(2) != 2)
        throw nb::value_error("segments (s, 2), (s, 2) and parts (p, m, 2), (p, m) expected");
    for (size_t s = 0; s < segments; ++s) {
        bool free = true;
        for (size_t p = 0; free && p < parts; ++p)
            free = !runs_through(a.data() + 2 * s, b.data() + 2 * s, normals.data() + 2 * planes * p,
                                 limits.data() + planes * p, planes, least);
        out.data()[s] = free;
    }
}

NB_MODULE(_clipping, m) { m.def("clear", &clear); }
