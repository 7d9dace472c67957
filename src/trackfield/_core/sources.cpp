// Python's door to the search for signal sources.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "source_search.hpp"

namespace nb = nanobind;
using namespace trackfield::signals;

using In = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using InMatrix = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

template <class T>
static nb::object array(const std::vector<T> &values, size_t columns) {
    T *data = new T[values.size() + 1];
    std::copy(values.begin(), values.end(), data);
    nb::capsule owner(data, [](void *p) noexcept { delete[] static_cast<T *>(p); });
    size_t shape[2] = {values.size() / columns, columns};
    return nb::cast(nb::ndarray<nb::numpy, T>(data, 2, shape, owner));
}

static double get(const nb::dict &d, const char *key) { return nb::cast<double>(d[key]); }

static Settings settings_from(const nb::dict &d) {
    Settings s;
    s.leader_sigmas = get(d, "leader_sigmas");
    s.leader_radius = get(d, "leader_radius_m");
    s.fit_radius = get(d, "fit_radius_m");
    s.group_radius = get(d, "group_radius_m");
    s.max_step = get(d, "max_step_m");
    s.gain = get(d, "gain");
    s.split_gain = get(d, "split_gain");
    s.outlier_sigmas = get(d, "outlier_sigmas");
    s.group = int(get(d, "group"));
    s.rounds = int(get(d, "rounds"));
    s.work = int64_t(get(d, "work"));
    return s;
}

// Columns of a source: x y xx xy yy factor gain misfit.
static nb::tuple locate(InMatrix places, In z, nb::list columns, double factor_sigma, bool strongest_only, const nb::dict &settings) {
    Field f;
    f.n = places.shape(0);
    if (places.shape(1) != 2 || z.shape(0) != f.n) throw nb::value_error("sensors (n, 2) and values (n,) expected");
    f.places = places.data();
    f.z = z.data();
    f.factor_sigma = factor_sigma;
    f.strongest_only = strongest_only;
    Column *const all[] = {&f.amplitude, &f.falloff, &f.exponent, &f.range, &f.sigma, &f.gain, &f.placement, &f.saturation};
    if (nb::len(columns) != 8) throw nb::value_error("8 columns expected");
    std::vector<In> kept;
    for (size_t k = 0; k < 8; ++k) {
        kept.push_back(nb::cast<In>(columns[k]));
        const size_t m = kept.back().shape(0);
        if (m != 1 && m != f.n) throw nb::value_error("columns of one entry or one a sensor expected");
        *all[k] = {kept.back().data(), m == 1 ? size_t(0) : size_t(1)};
    }
    const Settings s = settings_from(settings);
    std::vector<double> numbers;
    std::vector<int32_t> leaders, suspects;
    bool complete;
    {
        nb::gil_scoped_release release;
        Search search(f, s);
        search.run();
        for (const Found &one : search.sources()) {
            if (!one.alive) continue;
            const double row[] = {one.source.x, one.source.y, one.cov[0], one.cov[1], one.cov[2], std::exp(one.source.log_factor), one.gain, one.misfit};
            numbers.insert(numbers.end(), row, row + 8);
            leaders.push_back(one.source.leader);
        }
        suspects = search.suspects;
        complete = search.complete();
    }
    return nb::make_tuple(array(numbers, 8), array(leaders, 1), array(suspects, 1), complete);
}

NB_MODULE(_sources, m) { m.def("locate", &locate); }
