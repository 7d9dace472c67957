// Bytes of states that share frames, and back.
#pragma once

#include <map>

#include "bernoulli_names.hpp"
#include "bytes.hpp"

namespace trackfield {

template <class Ar> void visit(Ar &ar, Sym2 &s) { visit_all(ar, s.xx, s.xy, s.yy); }
template <class Ar> void visit(Ar &ar, Plane &p) { visit_all(ar, p.x, p.y, p.vx, p.vy, p.A, p.C, p.xu, p.xw, p.yu, p.yw); }
template <class Ar> void visit(Ar &ar, Leaf &l) {
    visit_all(ar, l.state, l.existence, l.weight, l.survival, l.parent);
    for (int32_t &z : l.recent) visit(ar, z);
}
template <class Ar> void visit(Ar &ar, Track &t) { visit_all(ar, t.id, t.begin, t.end, t.first); }
template <class Ar> void visit(Ar &ar, Cluster &c) { visit_all(ar, c.begin, c.end, c.weight, c.leaf); }
template <class Ar> void visit(Ar &ar, Frame &f) { visit_all(ar, f.t, f.leaves, f.tracks, f.clusters); }
template <class Ar> void visit(Ar &ar, Learned &l) { visit_all(ar, l.sum, l.weight); }
template <class Ar> void visit(Ar &ar, StepCounts &c) { visit_all(ar, c.enumerated, c.propagated, c.burst, c.crowded_out, c.work); }

template <class Ar> void visit(Ar &ar, Name &n) {
    visit_all(ar, n.track, n.identity, n.seen, n.shown);
    for (int32_t &z : n.reports) visit(ar, z);
}
template <class Ar> void visit(Ar &ar, Names &n) { visit_all(ar, n.names, n.next); }

// All of a state but its frames, which stand as places in a table.
template <class Ar> void visit_rest(Ar &ar, BernoulliState &s, std::vector<uint32_t> &frames) {
    visit_all(ar, frames, s.undetected, s.false_reports, s.p_detection, s.variance, s.births, s.begun, s.counts);
    for (Learned &ring : s.shadow) visit(ar, ring);
}

inline std::string encode(std::vector<BernoulliState> states, Names names) {
    Writer ar;
    visit(ar, names);
    std::map<const Frame *, uint32_t> known;
    std::vector<Frame> table;
    std::vector<std::vector<uint32_t>> frames(states.size());
    for (size_t i = 0; i < states.size(); ++i)
        for (auto &frame : states[i].frames) {
            const auto [at, fresh] = known.try_emplace(frame.get(), uint32_t(table.size()));
            if (fresh) table.push_back(*frame);
            frames[i].push_back(at->second);
        }
    visit(ar, table);
    uint64_t n = states.size();
    visit(ar, n);
    for (size_t i = 0; i < states.size(); ++i) visit_rest(ar, states[i], frames[i]);
    return ar.bytes;
}

// Whether places stay inside: damaged bytes must not be followed.
inline bool sound(const Frame &f) {
    const int32_t leaves = int32_t(f.leaves.size()), tracks = int32_t(f.tracks.size());
    for (const Track &t : f.tracks)
        if (t.begin < 0 || t.begin >= t.end || t.end > leaves) return false;
    for (const Cluster &c : f.clusters) {
        if (c.begin < 0 || c.begin >= c.end || c.end > tracks || c.weight.empty()) return false;
        if (c.leaf.size() != c.weight.size() * size_t(c.tracks())) return false;
        for (int32_t l : c.leaf)
            if (l < -1 || l >= leaves) return false;
    }
    return true;
}

inline std::pair<std::vector<BernoulliState>, Names> decode(const char *data, size_t size) {
    Reader ar{data, data + size};
    Names names;
    visit(ar, names);
    std::vector<Frame> table;
    visit(ar, table);
    std::vector<std::shared_ptr<const Frame>> shared;
    for (Frame &f : table) {
        if (!sound(f)) throw std::runtime_error("the snapshot is damaged");
        shared.push_back(std::make_shared<const Frame>(std::move(f)));
    }
    uint64_t n = 0;
    visit(ar, n);
    if (n > size) throw std::runtime_error("the snapshot is damaged");
    std::vector<BernoulliState> states(n);
    for (BernoulliState &s : states) {
        std::vector<uint32_t> frames;
        visit_rest(ar, s, frames);
        size_t before = 0;
        for (uint32_t k : frames) {
            if (k >= shared.size()) throw std::runtime_error("the snapshot is damaged");
            for (const Leaf &leaf : shared[k]->leaves)
                if (leaf.parent < -1 || (!s.frames.empty() && leaf.parent >= int32_t(before))) throw std::runtime_error("the snapshot is damaged");
            before = shared[k]->leaves.size();
            s.frames.push_back(shared[k]);
        }
    }
    if (ar.at != ar.end) throw std::runtime_error("the snapshot is longer than its contents");
    return {states, names};
}

}  // namespace trackfield
