// Python's door to the selection of sensors.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "selection_enumeration.hpp"
#include "selection_swaps.hpp"

namespace nb = nanobind;
using namespace trackfield::selection;

using InGains = nb::ndarray<const double, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using InVector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

static nb::object array(const Set &set) {
    int32_t *data = new int32_t[set.size() + 1];
    std::copy(set.begin(), set.end(), data);
    nb::capsule owner(data, [](void *p) noexcept { delete[] static_cast<int32_t *>(p); });
    size_t shape[1] = {set.size()};
    return nb::cast(nb::ndarray<nb::numpy, int32_t>(data, 1, shape, owner));
}

// Call with a field of the right dimension.
template <class Work>
static auto with_field(const InGains &gains, const InGains &priors, const InVector &weights, int criterion, Work work) {
    const size_t s = gains.shape(0), n = gains.shape(1), d = gains.shape(2);
    if (priors.shape(0) != s || priors.shape(1) != d || priors.shape(2) != d || weights.shape(0) != s)
        throw nb::value_error("gains (s, n, d), priors (s, d, d) and weights (s,) expected");
    const auto call = [&]<int D>() {
        return work(Field<D>(gains.data(), priors.data(), weights.data(), int(n), int(s), Criterion(criterion)));
    };
    switch (d) {
        case 1: return call.template operator()<1>();
        case 2: return call.template operator()<2>();
        case 3: return call.template operator()<3>();
        case 4: return call.template operator()<4>();
        case 5: return call.template operator()<5>();
        case 6: return call.template operator()<6>();
        default: throw nb::value_error("1 to 6 dimensions expected");
    }
}

static void check(int k, size_t n) {
    if (k < 1 || size_t(k) > n) throw nb::value_error("1 to n sensors expected");
}

static nb::object enumerated(InGains gains, InGains priors, InVector weights, int k, int criterion, double ridge) {
    check(k, gains.shape(1));
    Set best;
    {
        nb::gil_scoped_release release;
        best = with_field(gains, priors, weights, criterion, [&]<int D>(const Field<D> &field) { return Enumeration<D>(field, k, ridge).best(); });
    }
    return array(best);
}

static nb::object exchanged(InGains gains, InGains priors, InVector weights, int k, int criterion, double ridge) {
    check(k, gains.shape(1));
    Set best;
    {
        nb::gil_scoped_release release;
        best = with_field(gains, priors, weights, criterion, [&]<int D>(const Field<D> &field) {
            Swaps<D> search(field, ridge);
            Set set = search.greedy(k);
            search.improve(set);
            return set;
        });
    }
    return array(best);
}

NB_MODULE(_selection, m) {
    m.def("enumerated", &enumerated);
    m.def("exchanged", &exchanged);
}
