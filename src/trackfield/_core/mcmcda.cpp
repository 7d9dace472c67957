// Python's door to the sampler of partitions.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/vector.h>

#include <memory>
#include <variant>

#include "mcmcda_chain.hpp"

namespace nb = nanobind;
using namespace trackfield;
using namespace trackfield::mcmcda;

using In = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using InInt = nb::ndarray<const int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using InMatrix = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

static std::vector<double> copied(const In &a) { return {a.data(), a.data() + a.shape(0)}; }

template <class T>
static nb::object matrix(std::vector<T> *data, size_t rows, size_t columns) {
    nb::capsule owner(data, [](void *p) noexcept { delete static_cast<std::vector<T> *>(p); });
    return nb::cast(nb::ndarray<nb::numpy, T>(data->data(), {rows, columns}, owner));
}

template <class T>
static T get(const nb::dict &d, const char *key) {
    return nb::cast<T>(d[key]);
}

static Settings settings_from(const nb::dict &d) {
    Settings s;
    s.velocity_variance = get<double>(d, "velocity_variance");
    s.max_speed = get<double>(d, "max_speed");
    s.margin = get<double>(d, "margin");
    s.stop = get<double>(d, "stop");
    s.gaps = get<std::vector<double>>(d, "gaps");
    s.moves = get<std::array<double, kMoves>>(d, "moves");
    s.informed = get<bool>(d, "informed");
    s.marginal_death = get<bool>(d, "marginal_death");
    s.log_death = get<double>(d, "log_death");
    s.region = get<std::array<double, 4>>(d, "region");
    s.frozen = get<int>(d, "frozen");
    if (s.gaps.empty()) throw nb::value_error("at least one gap expected");
    if (s.frozen < 0) throw nb::value_error("a number of frozen slots expected");
    return s;
}

// Reports: slot, and columns x y xx xy yy log_birth log_false. Slots: times, survival, detection (slots, reports).
static Window window_from(const nb::dict &d, const InInt &slot, const InMatrix &reports, const In &times, const In &survival, const InMatrix &detection) {
    Window w;
    w.set = settings_from(d);
    const size_t n = slot.shape(0), T = times.shape(0);
    if (reports.shape(0) != n || reports.shape(1) != 7) throw nb::value_error("7 columns a report expected");
    if (survival.shape(0) != T || detection.shape(0) != T || detection.shape(1) != n)
        throw nb::value_error("a survival and a row of detection probabilities a slot expected");
    if (T > size_t(kMostSlots)) throw nb::value_error("at most 64 slots expected");
    w.times = copied(times);
    w.survival = copied(survival);
    w.detection = {detection.data(), detection.data() + T * n};
    for (size_t i = 0; i < n; ++i) {
        const double *r = reports.data() + 7 * i;
        const int32_t at = slot.data()[i];
        if (at < 0 || at >= int(T) || (i > 0 && at < slot.data()[i - 1])) throw nb::value_error("reports in the order of their slots expected");
        w.reports.push_back({r[0], r[1], r[2], r[3], r[4], at});
        w.log_birth.push_back(r[5]);
        w.log_false.push_back(r[6]);
    }
    w.prepare(get<double>(d, "accel_variance"), get<double>(d, "step"));
    return w;
}

static bool all_round(const Window &w) {
    for (const Report &r : w.reports)
        if (r.xx != r.yy || r.xy != 0) return false;
    return true;
}

// A chain over the partitions of one window.
class Sampler {
  public:
    Sampler(const nb::dict &settings, const InInt &slot, const InMatrix &reports, const In &times, const In &survival, const InMatrix &detection, const InInt &owner, const std::array<uint64_t, 4> &random)
        : window_(window_from(settings, slot, reports, times, survival, detection)) {
        if (owner.shape(0) != slot.shape(0)) throw nb::value_error("an owner a report expected");
        const Xoshiro rng{{random[0], random[1], random[2], random[3]}};
        if (all_round(window_))
            chain_ = std::make_unique<Chain<Round>>(window_, rng, owner.data());
        else
            chain_ = std::make_unique<Chain<Oblique>>(window_, rng, owner.data());
    }

    Sampler(const Sampler &) = delete;

    template <class F>
    auto with(F f) {
        return std::visit([&](auto &chain) { return f(*chain); }, chain_);
    }

    void advance(int64_t moves) {
        nb::gil_scoped_release release;
        with([&](auto &chain) {
            for (int64_t m = 0; m < moves; ++m) chain.step();
        });
    }

    // The partition after every `every` moves, (samples, n): track of each report, -1 of none.
    nb::object trace(int samples, int every) {
        const size_t n = window_.size();
        auto out = std::make_unique<std::vector<int16_t>>(size_t(samples) * n);
        {
            nb::gil_scoped_release release;
            with([&](auto &chain) {
                int16_t *at = out->data();
                for (int s = 0; s < samples; ++s) {
                    for (int m = 0; m < every; ++m) chain.step();
                    for (const int32_t owner : chain.tracks().owners()) *at++ = int16_t(owner);
                }
            });
        }
        return matrix(out.release(), samples, n);
    }

    std::vector<int32_t> owners() {
        return with([](auto &chain) { return chain.tracks().owners(); });
    }

    std::vector<int32_t> best() {
        return with([](auto &chain) { return chain.best(); });
    }

    std::array<double, 3> scores() {
        return with([](auto &chain) { return std::array<double, 3>{chain.score(), chain.best_score(), chain.fresh_score()}; });
    }

    std::array<std::array<int64_t, kMoves>, 2> counts() {
        return with([](auto &chain) { return std::array<std::array<int64_t, kMoves>, 2>{chain.counts.proposed, chain.counts.accepted}; });
    }

    std::array<uint64_t, 4> random() {
        return with([](auto &chain) { return std::array<uint64_t, 4>{chain.rng.s[0], chain.rng.s[1], chain.rng.s[2], chain.rng.s[3]}; });
    }

    size_t links() const { return window_.links(); }

  private:
    Window window_;
    std::variant<std::unique_ptr<Chain<Round>>, std::unique_ptr<Chain<Oblique>>> chain_;
};

NB_MODULE(_mcmcda, m) {
    nb::class_<Sampler>(m, "Sampler")
        .def(nb::init<const nb::dict &, const InInt &, const InMatrix &, const In &, const In &, const InMatrix &, const InInt &, const std::array<uint64_t, 4> &>(),
             nb::arg("settings"), nb::arg("slot"), nb::arg("reports"), nb::arg("times"), nb::arg("survival"), nb::arg("detection"), nb::arg("owner"), nb::arg("random"))
        .def("advance", &Sampler::advance)
        .def("trace", &Sampler::trace)
        .def("owners", &Sampler::owners)
        .def("best", &Sampler::best)
        .def("scores", &Sampler::scores)
        .def("counts", &Sampler::counts)
        .def("random", &Sampler::random)
        .def("links", &Sampler::links);
}
