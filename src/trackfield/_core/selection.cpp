// Python's door to the selection of sensors.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "selection_enumeration.hpp"
#include "selection_frugal.hpp"
#include "selection_left.hpp"

namespace nb = nanobind;
using namespace trackfield::selection;

using InGains = nb::ndarray<const double, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using InSet = nb::ndarray<const int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using InVector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

template <class T>
static nb::object array(const std::vector<T> &values, std::initializer_list<size_t> shape) {
    T *data = new T[values.size() + 1];
    std::copy(values.begin(), values.end(), data);
    nb::capsule owner(data, [](void *p) noexcept { delete[] static_cast<T *>(p); });
    return nb::cast(nb::ndarray<nb::numpy, T>(data, shape.size(), shape.begin(), owner));
}

template <int D>
static std::vector<double> square(const Packed<D> &m) {
    std::vector<double> out;
    for (int i = 0; i < D; ++i)
        for (int j = 0; j < D; ++j) out.push_back(m.both(i, j));
    return out;
}

static std::vector<double> listed(const InVector &values) { return {values.data(), values.data() + values.shape(0)}; }

// Weight of the only place.
static std::vector<double> certain() { return {1.0}; }

// Call with a number of dimensions known to the compiler.
template <class Work>
static void with_dimension(size_t d, Work work) {
    switch (d) {
        case 1: return work.template operator()<1>();
        case 2: return work.template operator()<2>();
        case 3: return work.template operator()<3>();
        case 4: return work.template operator()<4>();
        case 5: return work.template operator()<5>();
        case 6: return work.template operator()<6>();
        default: throw nb::value_error("1 to 6 dimensions expected");
    }
}

// Call with the field of these gains.
template <class Work>
static void with_field(const InGains &gains, const InGains &priors, const std::vector<double> &weights, int criterion, Work work) {
    const size_t s = gains.shape(0), n = gains.shape(1), d = gains.shape(2);
    if (priors.shape(0) != s || priors.shape(1) != d || priors.shape(2) != d || weights.size() != s)
        throw nb::value_error("gains (s, n, d), priors (s, d, d) and weights (s,) expected");
    with_dimension(d, [&]<int D>() { work(Field<D>(gains.data(), priors.data(), weights.data(), int(n), int(s), Criterion(criterion))); });
}

static void check(const InGains &gains, int k, bool at_one_place) {
    if (k < 1 || size_t(k) > gains.shape(1)) throw nb::value_error("1 to n sensors expected");
    if (at_one_place && gains.shape(0) != 1) throw nb::value_error("gains at one place expected");
}

static nb::object enumerated(InGains gains, InGains priors, InVector weights, int k, int criterion, double ridge) {
    check(gains, k, false);
    Set best;
    {
        nb::gil_scoped_release release;
        with_field(gains, priors, listed(weights), criterion, [&]<int D>(const Field<D> &field) { best = Enumeration<D>(field, k, ridge).best(); });
    }
    return array(best, {best.size()});
}

static nb::object exchanged(InGains gains, InGains priors, InVector weights, int k, int criterion, double ridge) {
    check(gains, k, false);
    Set best;
    {
        nb::gil_scoped_release release;
        with_field(gains, priors, listed(weights), criterion, [&]<int D>(const Field<D> &field) {
            Swaps<D> search(field, ridge);
            best = search.greedy(k);
            search.improve(best);
        });
    }
    return array(best, {best.size()});
}

// Best set, the bound of all sets and the slope that proves it, and whether the set was proved best.
static nb::tuple searched(InGains gains, InGains priors, int k, int criterion, double ridge, int64_t work) {
    check(gains, k, true);
    Set best;
    std::vector<double> slope;
    double bound = 0;
    bool complete = false;
    {
        nb::gil_scoped_release release;
        with_field(gains, priors, certain(), criterion, [&]<int D>(const Field<D> &field) {
            Found<D> found = search(field, k, ridge, work);
            best = std::move(found.set);
            slope = square(found.cut.slope);
            bound = found.cut.bound;
            complete = found.complete;
        });
    }
    return nb::make_tuple(array(best, {best.size()}), bound, array(slope, {gains.shape(2), gains.shape(2)}), complete);
}

// Shares of sensors, the value they reach, the bound of all shares and the slope that proves it.
static nb::tuple relaxed(InGains gains, InGains priors, int k, int criterion, double ridge, double tolerance) {
    check(gains, k, true);
    std::vector<double> shares, slope;
    double value = 0, bound = 0;
    {
        nb::gil_scoped_release release;
        with_field(gains, priors, certain(), criterion, [&]<int D>(const Field<D> &field) {
            Limits limits;
            limits.most[0] = k;
            Swaps<D> swaps(field, ridge);
            Relaxed<D> found = relax(field, limits, ridge, tolerance, field.state_of(swaps.greedy(k), ridge)[0]);
            shares = std::move(found.share);
            slope = square(found.cut.slope);
            value = found.value;
            bound = found.cut.bound;
        });
    }
    return nb::make_tuple(array(shares, {shares.size()}), value, bound, array(slope, {gains.shape(2), gains.shape(2)}));
}

// As searched, of sets of at most k sensors that cost no more than a budget.
static nb::tuple affordable(InGains gains, InGains priors, int k, int criterion, double ridge, InVector costs, double budget, int64_t work) {
    check(gains, k, true);
    if (costs.shape(0) != gains.shape(1)) throw nb::value_error("costs (n,) expected");
    Set best;
    double bound = 0;
    bool complete = false;
    {
        nb::gil_scoped_release release;
        with_field(gains, priors, certain(), criterion, [&]<int D>(const Field<D> &field) {
            Found<D> found = best_affordable(field, k, ridge, costs.data(), budget, work);
            best = std::move(found.set);
            bound = found.cut.bound;
            complete = found.complete;
        });
    }
    return nb::make_tuple(array(best, {best.size()}), bound, complete);
}

// Cheapest set of at most k sensors of a merit, what all such sets cost at least, and whether the
// set was proved cheapest; `able` is one of them.
static nb::tuple sufficient(InGains gains, InGains priors, int k, int criterion, double ridge, InVector costs, double level, InSet able, int64_t work) {
    check(gains, k, true);
    if (costs.shape(0) != gains.shape(1)) throw nb::value_error("costs (n,) expected");
    Set best(able.data(), able.data() + able.shape(0));
    double bound = 0;
    bool complete = false;
    {
        nb::gil_scoped_release release;
        with_field(gains, priors, certain(), criterion, [&]<int D>(const Field<D> &field) {
            Cheapest<D> found = cheapest(field, best, k, ridge, costs.data(), level, work);
            best = std::move(found.set);
            bound = found.bound;
            complete = found.complete;
        });
    }
    return nb::make_tuple(array(best, {best.size()}), bound, complete);
}

// What readings of these rows leave: covariance (d, d), free directions (m, d), value.
static nb::tuple left(InGains gains, InGains priors, InSet rows, int criterion) {
    if (gains.shape(0) != 1) throw nb::value_error("gains at one place expected");
    for (size_t p = 0; p < rows.shape(0); ++p)
        if (rows(p) < 0 || size_t(rows(p)) >= gains.shape(1)) throw nb::value_error("rows of the gains expected");
    const size_t d = gains.shape(2);
    nb::tuple out;
    with_dimension(d, [&]<int D>() {
        Packed<D> information;
        for (int i = 0; i < D; ++i)
            for (int j = 0; j <= i; ++j) information(i, j) = priors(0, i, j);
        for (size_t p = 0; p < rows.shape(0); ++p) information.add_outer(&gains(0, rows(p), 0));
        const Left<D> found(information, Criterion(criterion));
        out = nb::make_tuple(array(square(found.covariance), {d, d}), array(found.missing, {found.missing.size() / d, d}), found.value);
    });
    return out;
}

NB_MODULE(_selection, m) {
    m.def("left", &left);
    m.def("enumerated", &enumerated);
    m.def("exchanged", &exchanged);
    m.def("searched", &searched);
    m.def("relaxed", &relaxed);
    m.def("affordable", &affordable);
    m.def("sufficient", &sufficient);
}
