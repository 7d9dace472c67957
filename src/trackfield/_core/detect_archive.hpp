// Bytes of a field's belief and back.
#pragma once

#include "bytes.hpp"
#include "detect_belief.hpp"

namespace trackfield::detect {

using trackfield::visit;
using trackfield::visit_all;

}  // namespace trackfield::detect

namespace trackfield {

template <class Ar> void visit(Ar &ar, detect::Point &p) { visit_all(ar, p.x, p.y, p.vx, p.vy); }
template <class Ar> void visit(Ar &ar, detect::Seen &e) { visit_all(ar, e.sensor, e.covered); }
template <class Ar> void visit(Ar &ar, detect::Support &e) { visit_all(ar, e.sensor, e.log_ratio); }
template <class Ar> void visit(Ar &ar, detect::Node &n) { visit_all(ar, n.dead, n.stuck); }
template <class Ar> void visit(Ar &ar, detect::Rate &r) { visit_all(ar, r.hits, r.tries); }
template <class Ar> void visit(Ar &ar, detect::Record &r) {
    visit_all(ar, r.t, r.existence, r.survival);
    for (double &v : r.mean) visit(ar, v);
    for (double &v : r.cov) visit(ar, v);
}
template <class Ar> void visit(Ar &ar, std::vector<std::vector<detect::Point>> &past) {
    uint64_t n = past.size();
    visit(ar, n);
    if constexpr (Ar::reading) {
        if (n > size_t(ar.end - ar.at)) throw std::runtime_error("the snapshot is damaged");
        past.resize(n);
    }
    for (auto &step : past) visit(ar, step);
}
template <class Ar> void visit(Ar &ar, detect::Cloud &c) { visit_all(ar, c.x, c.y, c.vx, c.vy, c.here, c.past); }
template <class Ar> void visit(Ar &ar, detect::Member &m) {
    visit_all(ar, m.track, m.first, m.existence, m.confirmed, m.cloud, m.cover);
    for (double &v : m.mean) visit(ar, v);
    for (double &v : m.cov) visit(ar, v);
    visit_all(ar, m.records, m.support, m.log_ratio);
}
template <class Ar> void visit(Ar &ar, detect::Group &g) { visit_all(ar, g.members, g.weight); }
template <class Ar> void visit(Ar &ar, detect::Belief &b) {
    visit_all(ar, b.t, b.next_track, b.chance.key, b.chance.used, b.nodes, b.p, b.q, b.unseen, b.groups, b.ended, b.times);
}

}  // namespace trackfield

namespace trackfield::detect {

// Whether a belief that was read can be stepped: shapes fit, particles that exist are in the region.
inline bool sound(const Belief &b, const CoverageMap &map, size_t sensors, size_t unseen) {
    if (b.nodes.size() != sensors || b.unseen.size() != unseen) return false;
    auto known = [&](const auto &list) {
        for (const auto &e : list)
            if (e.sensor < 0 || size_t(e.sensor) >= sensors) return false;
        return true;
    };
    for (const Group &g : b.groups) {
        const size_t n = g.weight.size();
        if (g.members.empty() || n == 0) return false;
        for (const Member &m : g.members) {
            const Cloud &c = m.cloud;
            for (size_t size : {c.x.size(), c.y.size(), c.vx.size(), c.vy.size(), c.here.size()})
                if (size != n) return false;
            for (const auto &step : c.past)
                if (step.size() != n) return false;
            if (!known(m.cover) || !known(m.support)) return false;
            for (size_t j = 0; j < n; ++j)
                if ((c.here[j] || !g.joint()) && map.at(c.x[j], c.y[j]) < 0) return false;
        }
    }
    return true;
}

}  // namespace trackfield::detect
