// Python's door to a step of the tracker of bearings, angular rates and motion.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "angle_bank.hpp"

namespace nb = nanobind;
using namespace trackfield::angles;

using In = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using InMatrix = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using InCube = nb::ndarray<const double, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using InFour = nb::ndarray<const double, nb::ndim<4>, nb::c_contig, nb::device::cpu>;

template <size_t Axes>
static nb::object array(const double *values, const size_t (&shape)[Axes]) {
    size_t size = 1;
    for (const size_t extent : shape) size *= extent;
    double *data = new double[size + 1];
    std::copy(values, values + size, data);
    nb::capsule owner(data, [](void *p) noexcept { delete[] static_cast<double *>(p); });
    return nb::cast(nb::ndarray<nb::numpy, double>(data, Axes, shape, owner));
}

static std::vector<Look> looks_of(InMatrix table, In value, In alive) {
    std::vector<Look> looks(value.shape(0));
    if (table.shape(0) != looks.size() || alive.shape(0) != looks.size() || table.shape(1) != 12)
        throw nb::value_error("sensors (m, 12) and readings (m,) expected");
    for (size_t i = 0; i < looks.size(); ++i) {
        const double *row = table.data() + 12 * i;
        Look &look = looks[i];
        look.says = int(row[0]);
        std::copy(row + 1, row + 4, look.place);
        std::copy(row + 4, row + 7, look.velocity);
        look.sigma = row[7], look.bias = row[8], look.falloff = row[9];
        look.threshold = row[10], look.reach = row[11];
        look.value = value.data()[i];
        look.alive = alive.data()[i];
    }
    return looks;
}

// One step of all hypotheses (H), each a bank of modes (M): mixed, moved by dt, conditioned on the
// readings. Motions (M, 2): density of acceleration and mean stay; kinds (K, 2): share and spread of
// readings; iteration: steps, halvings, tolerance.
static nb::tuple step(InMatrix shares, InCube mean, InFour covariance, double dt, InMatrix motions, InMatrix kinds,
                      In iteration, InMatrix table, In value, In alive) {
    const size_t H = shares.shape(0), M = shares.shape(1), n = mean.shape(2), m = value.shape(0);
    if ((n != 4 && n != 6) || mean.shape(0) != H || mean.shape(1) != M || covariance.shape(0) != H ||
        covariance.shape(1) != M || covariance.shape(2) != n || covariance.shape(3) != n || motions.shape(0) != M ||
        motions.shape(1) != 2 || kinds.shape(1) != 2 || kinds.shape(0) < 1 || kinds.shape(0) > 8 ||
        iteration.shape(0) != 3)
        throw nb::value_error("hypotheses (H, M), (H, M, n), (H, M, n, n) and settings of their shapes expected");
    const std::vector<Look> looks = looks_of(table, value, alive);
    Rules rules{int(iteration.data()[0]), int(iteration.data()[1]), iteration.data()[2], {}, {}};
    for (size_t k = 0; k < kinds.shape(0); ++k) {
        rules.shares.push_back(kinds.data()[2 * k]);
        rules.spreads.push_back(kinds.data()[2 * k + 1]);
    }
    Tables out(H, M, n, m);
    for (size_t h = 0; h < H; ++h) {
        Bank bank(int(n), M, shares.data() + h * M, mean.data() + h * M * n, covariance.data() + h * M * n * n);
        bank.predict(dt, motions.data());
        out.put_prior(h, bank.combined());
        out.log_likelihood[h] = bank.update(looks, rules, &out.nis[h], out.chance.data() + h * m);
        out.put(h, bank);
    }
    return nb::make_tuple(array(out.shares.data(), {H, M}), array(out.mean.data(), {H, M, n}),
                          array(out.covariance.data(), {H, M, n, n}), array(out.prior_mean.data(), {H, n}),
                          array(out.prior_covariance.data(), {H, n, n}), array(out.whole_mean.data(), {H, n}),
                          array(out.whole_covariance.data(), {H, n, n}), array(out.log_likelihood.data(), {H}),
                          array(out.nis.data(), {H}), array(out.chance.data(), {H, m}));
}

NB_MODULE(_angles, m) { m.def("step", &step); }
