// Python's door to track-before-detect on binary fields.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>

#include "detect_archive.hpp"
#include "detect_filter.hpp"

namespace nb = nanobind;
using namespace trackfield::detect;

template <class T> using In = nb::ndarray<const T, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

template <class T> static nb::object array(std::vector<T> values, size_t columns = 0) {
    auto *kept = new std::vector<T>(std::move(values));
    nb::capsule owner(kept, [](void *p) noexcept { delete static_cast<std::vector<T> *>(p); });
    size_t shape[2] = {columns ? kept->size() / columns : kept->size(), columns};
    return nb::cast(nb::ndarray<nb::numpy, T>(kept->data(), columns ? 2 : 1, shape, owner));
}

static Settings settings_from(const nb::dict &d) {
    Settings s;
    auto get = [&](auto &field, const char *key) { field = nb::cast<std::decay_t<decltype(field)>>(d[key]); };
    get(s.particles, "particles");
    get(s.accel_density, "accel_density");
    get(s.turn_rate, "turn_rate");
    get(s.turn_sigma, "turn_sigma");
    get(s.velocity_sigma, "velocity_sigma");
    get(s.lifetime, "lifetime");
    get(s.births_per_s, "births_per_s");
    get(s.initial_count, "initial_count");
    get(s.temper, "temper");
    get(s.join, "join");
    get(s.part, "part");
    get(s.group_size, "group_size");
    get(s.most_members, "most_members");
    get(s.drop, "drop");
    get(s.confirm, "confirm");
    get(s.mature, "mature");
    get(s.birth_radius, "birth_radius");
    get(s.birth_reach, "birth_reach");
    get(s.birth_stride, "birth_stride");
    get(s.births_per_step, "births_per_step");
    get(s.least_birth, "least_birth");
    get(s.name_horizon, "name_horizon");
    get(s.node_time, "node_time");
    get(s.dead, "dead");
    get(s.stuck, "stuck");
    get(s.most_new, "most_new");
    get(s.outage, "outage");
    get(s.says_zero, "says_zero");
    get(s.rate_weight, "rate_weight");
    get(s.rate_memory, "rate_memory");
    get(s.history, "history");
    get(s.support_time, "support_time");
    return s;
}

// The map as x_min, y_min, cell, rows, columns and its lists by cell; the sensors as p, q, delivery, group.
static void construct(Filter *self, const nb::dict &d, const nb::tuple &grid, In<int32_t> start, In<int32_t> sensor, In<double> covered, In<double> table) {
    CoverageMap map;
    map.x_min = nb::cast<double>(grid[0]), map.y_min = nb::cast<double>(grid[1]), map.cell = nb::cast<double>(grid[2]);
    map.rows = nb::cast<int>(grid[3]), map.columns = nb::cast<int>(grid[4]);
    map.start.assign(start.data(), start.data() + start.shape(0));
    for (size_t k = 0; k < sensor.shape(0); ++k) map.seen.push_back({sensor.data()[k], covered.data()[k]});
    std::vector<Sensor> sensors;
    for (const double *r = table.data(); r + 3 < table.data() + table.shape(0); r += 4) sensors.push_back({r[0], r[1], r[2], int(r[3])});
    if (map.start.size() != size_t(map.cells()) + 1 || map.start.back() != int32_t(map.seen.size()))
        throw nb::value_error("a list of sensors for every cell expected");
    new (self) Filter(settings_from(d), std::move(map), std::move(sensors));
}

// Rows of a step `lag` ago: t, then first, existence, mean (4), covariance (10); track, confirmed.
static nb::tuple rows(const Belief &b, int lag) {
    std::vector<double> numbers;
    std::vector<int32_t> names;
    for (const Past &p : hindsight(b, lag)) {
        numbers.insert(numbers.end(), {p.first, p.existence});
        numbers.insert(numbers.end(), p.at.mean, p.at.mean + 4);
        numbers.insert(numbers.end(), p.at.cov, p.at.cov + 10);
        const Member *now = nullptr;
        for (const Group &g : b.groups)
            for (const Member &m : g.members)
                if (m.track == p.track) now = &m;
        names.insert(names.end(), {p.track, p.confirmed, now && now->log_ratio > 0});
    }
    const double t = lag < int(b.times.size()) ? b.times[b.times.size() - 1 - lag] : 0;
    return nb::make_tuple(t, array(std::move(numbers), 16), array(std::move(names), 3));
}

static nb::object explain(const Belief &b, int32_t track) {
    for (const Group &g : b.groups)
        for (const Member &m : g.members) {
            if (m.track != track) continue;
            std::vector<int32_t> sensors;
            std::vector<double> ratios;
            for (const Support &o : m.support) sensors.push_back(o.sensor), ratios.push_back(o.log_ratio);
            return nb::make_tuple(m.existence, m.first, int(g.members.size()), array(std::move(sensors)), array(std::move(ratios)));
        }
    return nb::none();
}

NB_MODULE(_detect, m) {
    nb::class_<Belief>(m, "State")
        .def("rows", &rows)
        .def("explain", &explain)
        .def_ro("t", &Belief::t)
        .def("scans", [](const Belief &b) { return b.times.size(); })
        .def("dead", [](const Belief &b) {
            std::vector<double> v;
            for (const Node &n : b.nodes) v.push_back(n.dead);
            return array(std::move(v));
        })
        .def("stuck", [](const Belief &b) {
            std::vector<double> v;
            for (const Node &n : b.nodes) v.push_back(n.stuck);
            return array(std::move(v));
        });
    nb::class_<Filter>(m, "Filter")
        .def("__init__", &construct)
        .def("initial", &Filter::initial)
        .def("step",
             [](Filter &self, const Belief &b, double t, double dt, In<int8_t> value) {
                 if (value.shape(0) != self.sensors()) throw nb::value_error("a value of every sensor expected");
                 Belief next = b;
                 const Work w = self.step(next, t, dt, value.data());
                 nb::dict told;
                 told["births"] = w.births, told["largest_group"] = w.largest, told["members"] = w.members;
                 told["p_factor"] = next.p.factor(self.s.rate_weight), told["q_factor"] = next.q.factor(self.s.rate_weight);
                 return nb::make_tuple(std::move(next), told);
             })
        .def("encode",
             [](const Filter &, Belief b) {
                 trackfield::Writer ar;
                 trackfield::visit(ar, b);
                 return nb::bytes(ar.bytes.data(), ar.bytes.size());
             })
        .def("decode", [](const Filter &self, nb::bytes data) {
            trackfield::Reader ar{data.c_str(), data.c_str() + data.size()};
            Belief b;
            trackfield::visit(ar, b);
            if (ar.at != ar.end) throw std::runtime_error("the snapshot is longer than its contents");
            if (!self.fits(b)) throw std::runtime_error("the snapshot is of another field");
            return b;
        });
}
