// Python's door to the fit of energy profiles.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <optional>

#include "profile_fit.hpp"

namespace nb = nanobind;
using namespace trackfield::profiles;

using In = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using InMatrix = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using OutMatrix = nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

// Fits each row of values (b, m), sampled at times (1, m) or (b, m). Columns (b,) of the sensors; limits
// (b, 4): earliest and latest time, narrowest and widest width. Writes (b, 8): amplitude, time, width,
// cost, cost of nothing, cost of a constant, iterations, whether converged. Not `searched`, it starts where
// the paper does only.
static void fit(InMatrix times, InMatrix values, nb::list columns, InMatrix limits, bool rayleigh, bool searched, OutMatrix out) {
    const size_t rows = values.shape(0), n = values.shape(1);
    if (times.shape(1) != n || (times.shape(0) != 1 && times.shape(0) != rows) || n < 2 || nb::len(columns) != 3 ||
        limits.shape(0) != rows || limits.shape(1) != 4 || out.shape(0) != rows || out.shape(1) != 8)
        throw nb::value_error("times (1 or b, m), values (b, m), 3 columns, limits (b, 4) and out (b, 8) expected");
    const In exponent = nb::cast<In>(columns[0]), sigma = nb::cast<In>(columns[1]), top = nb::cast<In>(columns[2]);
    if (exponent.shape(0) != rows || sigma.shape(0) != rows || top.shape(0) != rows)
        throw nb::value_error("columns of one entry a row expected");
    nb::gil_scoped_release release;
    std::optional<Grid> grid;  // of the last row: rows of one exponent and one clock share it
    const double *before = nullptr;
    for (size_t i = 0; i < rows; ++i) {
        const double *t = times.data() + (times.shape(0) == 1 ? 0 : i * n), *r = values.data() + i * n;
        const double *limit = limits.data() + 4 * i;
        const Shape shape(exponent.data()[i]);
        const Noise noise{sigma.data()[i], top.data()[i], rayleigh};
        const Limits within{limit[0], limit[1], limit[2], limit[3]};
        if (!searched) grid.reset();
        else if (t != before || exponent.data()[i] != exponent.data()[i - 1] || !std::equal(limit, limit + 4, limit - 4))
            grid.emplace(t, n, shape, within, rayleigh);
        before = t;
        const Fitter fitter(t, r, n, shape, noise, within);
        std::vector<Numbers> starts;
        if (grid) starts = grid->starts(r, n, noise);
        const Fit best = fitter.best(coarse(t, r, n, within, 0.3 * noise.sigma), starts);
        double *row = out.data() + 8 * i;
        row[0] = best.a, row[1] = best.tm, row[2] = best.width;
        row[3] = best.cost, row[4] = fitter.flat_cost(0.0), row[5] = fitter.best_flat_cost();
        row[6] = best.iterations, row[7] = best.converged;
    }
}

NB_MODULE(_profiles, m) { m.def("fit", &fit); }
