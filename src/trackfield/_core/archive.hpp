// Bytes of a state and back. One `visit` a type serves both ways, so they cannot disagree.
#pragma once

#include <cstring>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>

#include "range_filter.hpp"

namespace trackfield {

struct Writer {
    std::string bytes;
    void raw(void *p, size_t n) { bytes.append(static_cast<const char *>(p), n); }
    static constexpr bool reading = false;
};

struct Reader {
    const char *at, *end;
    void raw(void *p, size_t n) {
        if (size_t(end - at) < n) throw std::runtime_error("the snapshot ends too early");
        if (n) std::memcpy(p, at, n);
        at += n;
    }
    static constexpr bool reading = true;
};

template <class Ar, class T>
    requires std::is_arithmetic_v<T>
void visit(Ar &ar, T &v) {
    ar.raw(&v, sizeof v);
}

template <class Ar> void visit(Ar &ar, Reading &r);
template <class Ar> void visit(Ar &ar, Slot &r);
template <class Ar> void visit(Ar &ar, Pending &r);
template <class Ar> void visit(Ar &ar, Belief &r);

template <class Ar, class T>
void visit(Ar &ar, std::vector<T> &v) {
    uint64_t n = v.size();
    ar.raw(&n, sizeof n);
    if constexpr (Ar::reading) {
        if (n > size_t(ar.end - ar.at)) throw std::runtime_error("the snapshot is damaged");
        v.resize(n);
    }
    if constexpr (std::is_arithmetic_v<T>)
        ar.raw(v.data(), n * sizeof(T));
    else
        for (T &x : v) visit(ar, x);
}

template <class Ar, class... T>
void visit_all(Ar &ar, T &...fields) {
    (visit(ar, fields), ...);
}

template <class Ar> void visit(Ar &ar, Reading &r) { visit_all(ar, r.t, r.value, r.sigma, r.sensor); }

template <class Ar> void visit(Ar &ar, Slot &s) { visit_all(ar, s.sensor, s.last, s.weight, s.power); }

template <class Ar> void visit(Ar &ar, Pending &p) {
    visit_all(ar, p.t, p.step, p.status, p.nis, p.mean, p.cov, p.gain);
}

template <class Ar> void visit(Ar &ar, Belief &b) {
    visit_all(ar, b.t, b.alive, b.track, b.step, b.last_update);
    for (int j = 0; j < kMaxModes; ++j) visit_all(ar, b.mode_probability[j], b.mean[j], b.cov[j]);
    visit_all(ar, b.m, b.P, b.slots, b.pool_weight, b.pool_power, b.heard, b.heard_nlos, b.heard_outlier);
    visit_all(ar, b.surprises, b.pending);
}

}  // namespace trackfield
