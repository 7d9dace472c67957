// Python's door to the compiled kernels.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>

#include "bank.hpp"

namespace nb = nanobind;
using namespace trackfield;

using In = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using InInt = nb::ndarray<const int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using InMatrix = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

template <class T>
static nb::object matrix(T *data, size_t rows, size_t columns) {
    nb::capsule owner(data, [](void *p) noexcept { delete[] static_cast<T *>(p); });
    size_t shape[2] = {rows, columns};
    return nb::cast(nb::ndarray<nb::numpy, T>(data, 2, shape, owner));
}

// Rows as two tables: t, position, velocity, covariance, NIS (11 columns); track, status, target.
static nb::tuple take(Bank &self) {
    const size_t n = self.rows.size();
    double *numbers = new double[n * 11 + 1], *d = numbers;
    int32_t *names = new int32_t[n * 3 + 1], *i = names;
    for (const Row &r : self.rows) {
        *d++ = r.t;
        for (int k = 0; k < 3; ++k) *d++ = r.position[k];
        for (int k = 0; k < 3; ++k) *d++ = r.velocity[k];
        for (int k = 0; k < 3; ++k) *d++ = r.cov[k];
        *d++ = r.nis;
        *i++ = r.track;
        *i++ = r.status;
        *i++ = r.target;
    }
    self.rows.clear();
    return nb::make_tuple(matrix(numbers, n, 11), matrix(names, n, 3));
}

static double get(const nb::dict &d, const char *key) { return nb::cast<double>(d[key]); }

static Settings settings_from(const nb::dict &d) {
    Settings s;
    s.dimensions = int(get(d, "dimensions"));
    s.height_open = get(d, "height_open") != 0;
    s.height = get(d, "height");
    s.height_sigma = get(d, "height_sigma");
    s.height_time = get(d, "height_time");
    s.scale_sigma = get(d, "scale_sigma");
    s.common_bias_sigma = get(d, "common_bias_sigma");
    s.velocity_time = get(d, "velocity_time");
    s.outage_velocity_time = get(d, "outage_velocity_time");
    s.velocity_sigma = get(d, "velocity_sigma");
    s.turn_sigma = get(d, "turn_sigma");
    s.turn_time = get(d, "turn_time");
    s.turn_max_step = get(d, "turn_max_step");
    s.turn_step = get(d, "turn_step");
    s.worst_factor = get(d, "worst_factor");
    s.prior_weight = get(d, "prior_weight");
    s.p_nlos = get(d, "p_nlos");
    s.nlos_sigmas = get(d, "nlos_sigmas");
    s.p_outlier = get(d, "p_outlier");
    s.outlier_sigmas = get(d, "outlier_sigmas");
    s.shares_weight = get(d, "shares_weight");
    s.memory_shares = get(d, "memory_shares");
    s.robust = get(d, "robust") != 0;
    s.iterations = int(get(d, "iterations"));
    s.noise_floor = get(d, "noise_floor");
    s.memory_own = get(d, "memory_own");
    s.memory_pool = get(d, "memory_pool");
    s.pool_weight = get(d, "pool_weight");
    s.slots = int(get(d, "slots"));
    s.slot_bias = get(d, "slot_bias") != 0;
    s.slot_correlated = get(d, "slot_correlated") != 0;
    s.slot_idle = get(d, "slot_idle");
    s.drop_time = get(d, "drop_time");
    s.lag_time = get(d, "lag_time");
    s.lag_steps = int(get(d, "lag_steps"));
    s.every = get(d, "every");
    s.window = get(d, "window");
    s.start_readings = int(get(d, "start_readings"));
    s.start_sensors = int(get(d, "start_sensors"));
    s.start_span = get(d, "start_span");
    s.restart_window = int(get(d, "restart_window"));
    nb::list modes = nb::cast<nb::list>(d["modes"]);
    s.modes = int(nb::len(modes));
    if (s.modes < 1 || s.modes > kMaxModes) throw nb::value_error("1 to 4 modes expected");
    for (int j = 0; j < s.modes; ++j) {
        nb::dict m = nb::cast<nb::dict>(modes[j]);
        s.mode[j].accel_density = get(m, "accel_density");
        s.mode[j].turns = get(m, "turns") != 0;
        s.mode[j].switch_rate = get(m, "switch_rate");
    }
    return s;
}

// Columns: x y z bias scale variance scale_variance max_range correlated_sigma correlation_length
// bias_sigma learn placement_variance
static std::vector<SensorModel> models_from(InMatrix table) {
    if (table.shape(1) != 13) throw nb::value_error("13 columns a sensor expected");
    std::vector<SensorModel> models(table.shape(0));
    for (size_t i = 0; i < models.size(); ++i) {
        const double *r = table.data() + i * 13;
        models[i] = {r[0], r[1], r[2], r[3], r[4], std::max(r[5], kLeastSigma * kLeastSigma), r[6], r[7], r[8], r[9], r[10], r[11] != 0, r[12], std::min(r[7] + 5 * std::sqrt(r[5]), kLongest)};
    }
    return models;
}

NB_MODULE(_kernels, m) {
    nb::class_<Bank>(m, "RangeBank")
        .def("__init__", [](Bank *self, const nb::dict &d, InMatrix sensors) { new (self) Bank(settings_from(d), models_from(sensors)); })
        .def("add_variant", [](Bank &self, InMatrix sensors) { return self.add_variant(models_from(sensors)); })
        .def("assign", &Bank::assign)
        .def("add",
             [](Bank &self, InInt target, In t, InInt sensor, In value, In sigma) {
                 const size_t n = t.shape(0);
                 if (target.shape(0) != n || sensor.shape(0) != n || value.shape(0) != n || sigma.shape(0) != n)
                     throw nb::value_error("columns of one length expected");
                 nb::gil_scoped_release release;
                 for (size_t i = 0; i < n; ++i)
                     self.add(target.data()[i],
                              Reading{t.data()[i], value.data()[i], float(sigma.data()[i]), sensor.data()[i]});
             })
        .def("step",
             // One complete scan of one target; the last row as numbers, None if nothing is shown.
             [](Bank &self, int32_t target, double t, InInt sensor, In value) -> nb::object {
                 const size_t n = sensor.shape(0);
                 if (value.shape(0) != n) throw nb::value_error("columns of one length expected");
                 const int32_t sensors = int32_t(self.heard.size());
                 for (size_t i = 0; i < n; ++i) {
                     const int32_t a = sensor.data()[i];
                     if (a < 0 || a >= sensors) throw nb::value_error("a sensor number that the site does not have");
                     if (!std::isfinite(value.data()[i])) throw nb::value_error("a value that is not finite");
                 }
                 if (!std::isfinite(t)) throw nb::value_error("a time that is not finite");
                 for (size_t i = 0; i < n; ++i)
                     self.add(target, Reading{t, value.data()[i], NAN, sensor.data()[i]});
                 self.settle(target);
                 if (self.rows.empty()) return nb::none();
                 const Row r = self.rows.back();
                 self.rows.clear();
                 return nb::make_tuple(r.t, r.position[0], r.position[1], r.position[2], r.velocity[0], r.velocity[1],
                                       r.velocity[2], r.cov[0], r.cov[1], r.cov[2], r.nis, r.track + 1, r.status);
             })
        .def("advance", &Bank::advance, nb::call_guard<nb::gil_scoped_release>())
        .def("finish", &Bank::finish, nb::call_guard<nb::gil_scoped_release>())
        .def("heard",
             [](const Bank &self) {
                 nb::list o;
                 for (size_t i = 0; i < self.heard.size(); ++i)
                     if (self.heard[i]) o.append(i);
                 return o;
             })
        .def("rows", [](const Bank &self) { return self.rows.size(); })
        .def("take", &take)
        .def("snapshot",
             [](Bank &self) {
                 const std::string bytes = self.snapshot();
                 return nb::bytes(bytes.data(), bytes.size());
             })
        .def("restore", [](Bank &self, const nb::bytes &data) { self.restore(data.c_str(), data.size()); })
        .def("counts", [](const Bank &self) {
            nb::dict o;
            const Counts c = self.total();
            o["accepted"] = c.accepted;
            o["duplicate"] = c.duplicate;
            o["late"] = c.late;
            o["out_of_range"] = c.out_of_range;
            o["started"] = c.started;
            o["restarted"] = c.restarted;
            o["ended"] = c.ended;
            o["rewound"] = c.rewound;
            return o;
        });
}
