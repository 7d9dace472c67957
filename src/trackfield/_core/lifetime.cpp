// Python's door to the search of sensor sets, many intervals at once.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "sensor_sets.hpp"

namespace nb = nanobind;
using namespace trackfield::sets;

using Ints = nb::ndarray<const int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Numbers = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Table = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

template <class T>
static nb::object table(T *data, size_t rows, size_t columns) {
    nb::capsule owner(data, [](void *p) noexcept { delete[] static_cast<T *>(p); });
    size_t shape[2] = {rows, columns};
    return nb::cast(nb::ndarray<nb::numpy, T>(data, 2, shape, owner));
}

template <class T>
static nb::object column(T *data, size_t rows) {
    nb::capsule owner(data, [](void *p) noexcept { delete[] static_cast<T *>(p); });
    size_t shape[1] = {rows};
    return nb::cast(nb::ndarray<nb::numpy, T>(data, 1, shape, owner));
}

// Candidates of interval t are entries offsets[t] .. offsets[t + 1] of nodes and gains.
struct Intervals {
    Ints offsets, nodes;
    Table gains;
    Numbers prices;
    Table prior;
    double bound;
    int k;

    void check() const {
        const int32_t entries = int32_t(nodes.shape(0)), n = int32_t(prices.shape(0));
        const size_t d = gains.shape(1);
        if (d != 2 && d != 3) throw nb::value_error("gains of 2 or 3 columns expected");
        if (prior.shape(0) != d || prior.shape(1) != d) throw nb::value_error("a prior as wide as the gains expected");
        if (gains.shape(0) != nodes.shape(0)) throw nb::value_error("a gain for each entry expected");
        if (k < 1 || k > 4) throw nb::value_error("sets of 1 to 4 sensors expected");
        if (offsets.shape(0) < 1 || offsets.data()[0] != 0 || offsets.data()[offsets.shape(0) - 1] != entries)
            throw nb::value_error("offsets from 0 to the number of entries expected");
        for (size_t t = 0; t + 1 < offsets.shape(0); ++t)
            if (offsets.data()[t + 1] < offsets.data()[t]) throw nb::value_error("rising offsets expected");
        for (int32_t e = 0; e < entries; ++e)
            if (nodes.data()[e] < 0 || nodes.data()[e] >= n) throw nb::value_error("a node that has no price");
    }

    size_t count() const { return offsets.shape(0) - 1; }

    // `loaded` makes an interval's search, at the prices of that moment.
    template <int D, int K, class Visit>
    void each(const double *price, const Visit &visit) const {
        Search<D, K> search(Information<D>::matrix(prior.data()), bound);
        for (size_t t = 0; t < count(); ++t) {
            const int32_t from = offsets.data()[t], size = offsets.data()[t + 1] - from;
            visit(t, from, [&]() -> Search<D, K> & {
                search.load(nodes.data() + from, gains.data() + size_t(from) * D, size, price);
                return search;
            });
        }
    }

    // Visit with dimensions and sizes that the compiler knows.
    template <class Visit>
    void visit_all(const double *price, const Visit &visit) const {
        const auto sized = [&]<int D>() {
            if (k == 1) each<D, 1>(price, visit);
            if (k == 2) each<D, 2>(price, visit);
            if (k == 3) each<D, 3>(price, visit);
            if (k == 4) each<D, 4>(price, visit);
        };
        gains.shape(1) == 2 ? sized.template operator()<2>() : sized.template operator()<3>();
    }
};

// The nodes (m, k) of each interval's best set, -1 where there is none, and its price or trace (m,).
template <class Pick>
static nb::tuple best(const Intervals &in, const Pick &pick) {
    in.check();
    const size_t m = in.count(), k = size_t(in.k);
    int32_t *chosen = new int32_t[m * k + 1];
    double *value = new double[m + 1];
    {
        nb::gil_scoped_release release;
        in.visit_all(in.prices.data(), [&](size_t t, int32_t from, const auto &loaded) {
            const auto c = pick(loaded());
            value[t] = c.value;
            for (size_t j = 0; j < k; ++j)
                chosen[t * k + j] = c.value < kNone ? in.nodes.data()[from + c.place[j]] : -1;
        });
    }
    return nb::make_tuple(table(chosen, m, k), column(value, m));
}

// Of each entry, in which share of its interval's good sets it is; and how many those are (m,).
static nb::tuple shares(const Intervals &in) {
    in.check();
    const size_t m = in.count(), entries = in.nodes.shape(0);
    double *share = new double[entries + 1], *sets = new double[m + 1];
    {
        nb::gil_scoped_release release;
        std::vector<double> each;
        in.visit_all(in.prices.data(), [&](size_t t, int32_t from, const auto &loaded) {
            const size_t size = size_t(in.offsets.data()[t + 1] - from);
            each.assign(size, 0.0);
            sets[t] = loaded().count(each);
            for (size_t i = 0; i < size; ++i) share[size_t(from) + i] = sets[t] > 0 ? each[i] / sets[t] : 0.0;
        });
    }
    return nb::make_tuple(column(share, entries), column(sets, m));
}

// Wear all nodes evenly: interval by interval, over and over, take the set with the least rise of
// sum x (l/x)^(p+1), given all other intervals' sets; every sweep's sets (sweeps, m, k).
static nb::object balance(const Intervals &in, double exponent, int sweeps) {
    in.check();
    const size_t m = in.count(), n = in.prices.shape(0), k = size_t(in.k);
    int32_t *all = new int32_t[size_t(sweeps) * m * k + 1];
    {
        nb::gil_scoped_release release;
        const double *x = in.prices.data();
        std::vector<double> load(n, 0.0), price(n);
        const auto shift = [&](int32_t i, double by) {
            load[i] += by;
            price[i] = x[i] > 0 ? std::pow((load[i] + 0.5) / x[i], exponent) : kNone;
        };
        for (size_t i = 0; i < n; ++i) shift(int32_t(i), 0.0);
        std::vector<int32_t> now(m * k, -1);
        for (int s = 0; s < sweeps; ++s) {
            in.visit_all(price.data(), [&](size_t t, int32_t from, const auto &loaded) {
                int32_t *c = now.data() + t * k;
                for (size_t j = 0; j < k; ++j)
                    if (c[j] >= 0) shift(c[j], -1.0);
                const auto best = loaded().cheapest();
                for (size_t j = 0; j < k; ++j) {
                    c[j] = best.value < kNone ? in.nodes.data()[from + best.place[j]] : -1;
                    if (c[j] >= 0) shift(c[j], 1.0);
                }
            });
            std::copy(now.begin(), now.end(), all + size_t(s) * m * k);
        }
    }
    return table(all, size_t(sweeps) * m, k);
}

NB_MODULE(_lifetime, m) {
    m.def("balance", [](Ints offsets, Ints nodes, Table gains, Numbers capacity, Table prior, double bound, int k, double exponent, int sweeps) {
        return balance({offsets, nodes, gains, capacity, prior, bound, k}, exponent, sweeps);
    });
    m.def("cheapest", [](Ints offsets, Ints nodes, Table gains, Numbers prices, Table prior, double bound, int k) {
        return best({offsets, nodes, gains, prices, prior, bound, k}, [](auto &search) { return search.cheapest(); });
    });
    m.def("sharpest", [](Ints offsets, Ints nodes, Table gains, Numbers prices, Table prior, int k) {
        return best({offsets, nodes, gains, prices, prior, kNone, k}, [](auto &search) { return search.sharpest(); });
    });
    m.def("shares", [](Ints offsets, Ints nodes, Table gains, Numbers prices, Table prior, double bound, int k) {
        return shares({offsets, nodes, gains, prices, prior, bound, k});
    });
}
