// Bytes of a range filter's belief and back.
#pragma once

#include "bytes.hpp"
#include "range_filter.hpp"

namespace trackfield {

template <class Ar> void visit(Ar &ar, Reading &r);
template <class Ar> void visit(Ar &ar, Slot &r);
template <class Ar> void visit(Ar &ar, Pending &r);
template <class Ar> void visit(Ar &ar, Belief &r);

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
