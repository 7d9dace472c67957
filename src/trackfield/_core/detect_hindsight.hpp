// What is believed of a step that has passed, given all scans since.
#pragma once

#include "detect_particles.hpp"

namespace trackfield::detect {

struct Past {
    int32_t track = 0;
    double first = 0, existence = 0;
    bool confirmed = false;
    Record at;
};

inline void remember(Cloud &c, int steps) {
    if (steps == 0) return;
    std::vector<Point> now(c.size());
    for (size_t j = 0; j < now.size(); ++j) now[j] = {float(c.x[j]), float(c.y[j]), float(c.vx[j]), float(c.vy[j])};
    c.past.insert(c.past.begin(), std::move(now));
    if (int(c.past.size()) > steps) c.past.pop_back();
}

inline void record(Member &m, double t, int steps) {
    Record r;
    r.t = t, r.existence = m.existence;
    std::copy(m.mean, m.mean + 4, r.mean);
    std::copy(m.cov, m.cov + 10, r.cov);
    m.records.push_back(r);
    if (int(m.records.size()) > steps + 1) m.records.erase(m.records.begin());
}

inline void end(Belief &b, const Member &m) {
    Member o = m;
    o.cloud = Cloud{};
    o.cover.clear();
    o.support.clear();
    o.existence = 0;
    b.ended.push_back(std::move(o));
}

inline void forget(Belief &b, int steps) {
    b.times.push_back(b.t);
    if (int(b.times.size()) > steps + 1) b.times.erase(b.times.begin());
    std::erase_if(b.ended, [&](const Member &m) { return m.records.empty() || m.records.back().t < b.times.front(); });
}

// Existence in a step, given what it is in the last one: death is for good, so that a member that
// is gone now may have been there with P(e_k | not e_k+1) = r_k (1 - s_k) / (1 - r_k s_k).
inline double smoothed_existence(const Member &m, size_t k) {
    double r = m.existence;
    const bool alive = m.cloud.size() > 0;
    for (size_t l = m.records.size() - alive; l-- > k;) {
        const Record &o = m.records[l];
        const double absent = 1 - o.existence * o.survival;
        r += (1 - r) * (absent > 0 ? o.existence * (1 - o.survival) / absent : 0);
    }
    return r;
}

// Members that had begun `lag` steps ago: their particles' pasts if they are likely there now,
// else what was believed then.
inline std::vector<Past> hindsight(const Belief &b, int lag) {
    std::vector<Past> found;
    if (lag >= int(b.times.size())) return found;
    const double t = b.times[b.times.size() - 1 - lag];
    auto add = [&](const Member &m, const std::vector<double> &weight) {
        size_t k = 0;
        while (k < m.records.size() && m.records[k].t != t) ++k;
        if (k == m.records.size()) return;
        Past p{m.track, m.first, lag ? smoothed_existence(m, k) : m.existence, m.confirmed, m.records[k]};
        if (lag && m.existence >= 0.5 && lag <= int(m.cloud.past.size())) {
            const std::vector<Point> &past = m.cloud.past[lag - 1];
            Cloud c;
            c.resize(past.size());
            c.here = m.cloud.here;
            for (size_t j = 0; j < past.size(); ++j) c.x[j] = past[j].x, c.y[j] = past[j].y, c.vx[j] = past[j].vx, c.vy[j] = past[j].vy;
            Member then;
            moments(weight, c, then);
            std::copy(then.mean, then.mean + 4, p.at.mean);
            std::copy(then.cov, then.cov + 10, p.at.cov);
        }
        found.push_back(p);
    };
    for (const Group &g : b.groups)
        for (const Member &m : g.members) add(m, g.weight);
    for (const Member &m : b.ended) add(m, {});
    std::sort(found.begin(), found.end(), [](const Past &x, const Past &y) { return x.track < y.track; });
    return found;
}

}  // namespace trackfield::detect
