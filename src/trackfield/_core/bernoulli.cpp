// Python's door to the Bernoulli mixture.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/vector.h>

#include "bernoulli_archive.hpp"
#include "bernoulli_hindsight.hpp"
#include "bernoulli_intake.hpp"
#include "bernoulli_step.hpp"

namespace nb = nanobind;
using namespace trackfield;

using In = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using InInt = nb::ndarray<const int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

static double get(const nb::dict &d, const char *key) { return nb::cast<double>(d[key]); }

static Map map_from(const nb::handle &value, const Rect &region) {
    Map map;
    map.region = region;
    nb::tuple given = nb::cast<nb::tuple>(value);  // the map's region, its values
    std::vector<double> box = nb::cast<std::vector<double>>(given[0]);
    In values = nb::cast<In>(given[1]);
    map.region = {box[0], box[1], box[2], box[3]};
    map.rows = int(values.shape(0));
    map.columns = int(values.shape(1));
    map.values.assign(values.data(), values.data() + values.size());
    return map;
}

static BernoulliModel model_from(const nb::dict &d) {
    BernoulliModel m;
    m.region = {get(d, "x_min"), get(d, "y_min"), get(d, "x_max"), get(d, "y_max")};
    m.accel_sigma = get(d, "accel_sigma");
    m.velocity_sigma = get(d, "velocity_sigma");
    m.survival = get(d, "survival");
    m.hazard = nb::cast<std::vector<double>>(d["hazard"]);
    m.births = get(d, "births");
    m.initial_count = get(d, "initial_count");
    m.birth_map = map_from(d["birth_map"], m.region);
    m.survival_map = map_from(d["survival_map"], m.region);
    m.step = get(d, "step");
    m.sigma = get(d, "sigma");
    for (nb::handle map : nb::cast<nb::list>(d["p_detection"])) m.p_detection.push_back(map_from(map, m.region));
    m.false_per_scan = get(d, "false_per_scan");
    m.false_map = map_from(d["false_map"], m.region);
    m.first_sigma = get(d, "first_sigma");
    m.first_p_detection = get(d, "first_p_detection");
    m.first_false = get(d, "first_false");
    m.first_births = get(d, "first_births");
    m.weight_sigma = get(d, "weight_sigma");
    m.weight_p_detection = get(d, "weight_p_detection");
    m.weight_false = get(d, "weight_false");
    m.weight_births = get(d, "weight_births");
    m.memory_sigma = get(d, "memory_sigma");
    m.memory_p_detection = get(d, "memory_p_detection");
    m.memory_false = get(d, "memory_false");
    m.memory_births = get(d, "memory_births");
    m.gate = get(d, "gate");
    m.least_existence = get(d, "least_existence");
    m.least_weight = get(d, "least_weight");
    m.joined_existence = get(d, "joined_existence");
    m.dependence = get(d, "dependence");
    m.duplicates = get(d, "duplicates");
    m.recent = int(get(d, "recent"));
    m.hypotheses = int(get(d, "hypotheses"));
    m.poor = get(d, "poor");
    m.leaves = int(get(d, "leaves"));
    m.max_tracks = int(get(d, "max_tracks"));
    m.work = int64_t(get(d, "work"));
    m.cluster_work = int64_t(get(d, "cluster_work"));
    m.history = int(get(d, "history"));
    m.cutoff = get(d, "cutoff");
    m.near = get(d, "near");
    if (m.recent < 0 || m.recent > kMaxRecent) throw nb::value_error("0 to 8 recent scans expected");
    return m;
}

template <class T> static nb::object array(const std::vector<T> &values, size_t rows, size_t columns) {
    T *data = new T[values.size() + 1];
    std::copy(values.begin(), values.end(), data);
    nb::capsule owner(data, [](void *p) noexcept { delete[] static_cast<T *>(p); });
    size_t shape[2] = {rows, columns};
    return nb::cast(nb::ndarray<nb::numpy, T>(data, 2, shape, owner));
}

// (n, 22) numbers: first, existence, mean (4), covariance (16); (n, 3) names: id, detected, shown.
static nb::tuple estimates(const BernoulliModel &m, const BernoulliState &s, const Names &identities, size_t lag) {
    if (lag >= s.frames.size()) throw nb::value_error("a lag within the scans kept expected");
    const std::vector<Believed> found = Hindsight(m, s).at(lag);
    std::vector<double> numbers;
    std::vector<int32_t> names;
    for (const Believed &b : found) {
        numbers.insert(numbers.end(), {b.first, b.existence, b.state.x, b.state.y, b.state.vx, b.state.vy});
        const Matrix4 P = dense(b.state);
        numbers.insert(numbers.end(), P.begin(), P.end());
        names.insert(names.end(), {identities.of(b.id), b.detected, b.shown});
    }
    return nb::make_tuple(s.frames[s.frames.size() - 1 - lag]->t, array(numbers, found.size(), 22), array(names, found.size(), 3));
}

// Existence, time of the first report, and (probability, reports newest first) of each history.
static nb::object explain(const BernoulliState &s, const Names &identities, int32_t identity) {
    if (s.frames.empty()) return nb::none();
    for (const Track &track : s.frames.back()->tracks) {
        if (identities.of(track.id) != identity) continue;
        double r = 0;
        nb::list histories;
        for (int32_t l = track.begin; l < track.end; ++l) {
            const Leaf &leaf = s.frames.back()->leaves[l];
            r += leaf.weight * leaf.existence;
            histories.append(nb::make_tuple(leaf.weight * leaf.existence, nb::cast(std::vector<int32_t>(leaf.recent.begin(), leaf.recent.end()))));
        }
        return nb::make_tuple(r, track.first, histories);
    }
    return nb::none();
}

static nb::dict told(const BernoulliState &s) {
    nb::dict o;
    o["enumerated"] = s.counts.enumerated;
    o["propagated"] = s.counts.propagated;
    o["burst"] = s.counts.burst;
    o["crowded_out"] = s.counts.crowded_out;
    o["work"] = s.counts.work;
    o["false_per_scan"] = s.false_reports.mean();
    o["p_detection"] = s.p_detection.mean();
    o["births"] = s.births.mean();
    o["sigma"] = std::sqrt(s.variance.mean());
    o["tracks"] = s.frames.empty() ? 0 : s.frames.back()->tracks.size();
    o["leaves"] = s.frames.empty() ? 0 : s.frames.back()->leaves.size();
    return o;
}

NB_MODULE(_bernoulli, m) {
    nb::class_<Names>(m, "Names").def(nb::init<>());
    nb::class_<BernoulliState>(m, "State").def(nb::init<>()).def("told", &told).def("scans", [](const BernoulliState &s) { return s.frames.size(); });
    nb::class_<BernoulliModel>(m, "Model")
        .def("__init__", [](BernoulliModel *self, const nb::dict &d) { new (self) BernoulliModel(model_from(d)); })
        .def("step",
             [](const BernoulliModel &self, const BernoulliState &state, double t, In position, In covariance, InInt number, int age, double share) {
                 const size_t n = number.shape(0);
                 if (position.shape(0) != n || covariance.shape(0) != n || position.shape(1) != 2 || covariance.shape(1) != 3)
                     throw nb::value_error("columns of one length expected");
                 BernoulliInput input{t, position.data(), covariance.data(), number.data(), n, age, share};
                 nb::gil_scoped_release release;
                 return BernoulliStep(self, state).run(input);
             })
        .def("estimates", &estimates)
        .def("renamed", [](const BernoulliModel &self, const BernoulliState &state, const Names &names, size_t replayed) { return renamed(names, self, state, replayed); })
        .def("check", [](const BernoulliModel &self, const BernoulliState &state) {
            if (!state.frames.empty() && state.undetected.size() != Undetected(self).values().size())
                throw nb::value_error("a state of a scene with other maps");
        });
    m.def("take_in", [](In position, In covariance, InInt number, const std::vector<double> &region, double variance, In known) {
        const Rect rect{region[0], region[1], region[2], region[3]};
        const Intake in = take_in(position.data(), covariance.data(), number.data(), number.shape(0), rect, variance, known.data(), known.shape(0));
        return nb::make_tuple(int(in.fault), array(in.keep, 1, in.keep.size()), in.outside, in.duplicate);
    });
    m.def("explain", &explain);
    m.def("encode", [](const std::vector<BernoulliState> &states, const Names &names) {
        const std::string bytes = encode(states, names);
        return nb::bytes(bytes.data(), bytes.size());
    });
    m.def("decode", [](const nb::bytes &data) { return decode(data.c_str(), data.size()); });
}
