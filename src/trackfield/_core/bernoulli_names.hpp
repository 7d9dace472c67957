// Identities that people see: they stay when hindsight explains a target by another track.
#pragma once

#include "bernoulli_hindsight.hpp"

namespace trackfield {

// A track's identity, and by which reports it was last shown.
struct Name {
    int32_t track = 0, identity = 0;
    double seen = 0;          // time of the last scan in which the track was possible
    double shown = -1e300;    // time of the last scan in which it was shown
    Recent reports{};
};

// A value: a scan makes a new one. Ordered by track.
struct Names {
    std::vector<Name> names;
    int32_t next = 1;

    int32_t of(int32_t track) const {
        const auto at = find(track);
        return at == names.end() || at->track != track ? 0 : at->identity;
    }
    std::vector<Name>::const_iterator find(int32_t track) const {
        return std::lower_bound(names.begin(), names.end(), track, [](const Name &n, int32_t t) { return n.track < t; });
    }
};

inline int shared_reports(const Recent &a, const Recent &b) {
    int count = 0;
    for (int32_t z : a)
        if (z >= 0 && std::find(b.begin(), b.end(), z) != b.end()) ++count;
    return count;
}

// After a scan, and `replayed` ones before it. Late reports, and explanations that take over, make tracks whose reports another one was shown by: the
// new track takes the identity over, and leaves its own to the old one.
inline Names renamed(const Names &before, const BernoulliModel &model, const BernoulliState &state, size_t replayed) {
    Names now = before;
    if (state.frames.empty()) return now;
    const size_t frames = state.frames.size();
    for (size_t k = frames - std::min(frames, replayed + 1); k < frames; ++k)  // a replay makes tracks anywhere
        for (const Track &track : state.frames[k]->tracks) {
            auto at = now.names.begin() + (now.find(track.id) - now.names.cbegin());
            if (at == now.names.end() || at->track != track.id) at = now.names.insert(at, Name{track.id, now.next++, 0, -1e300, {}});
            at->seen = state.frames[k]->t;
        }
    const double oldest = state.frames.front()->t, t = state.frames.back()->t;
    std::erase_if(now.names, [&](const Name &n) { return n.seen < oldest; });

    const std::vector<Believed> believed = Hindsight(model, state).at(0, 0.5);  // less is never shown
    std::vector<Name *> fresh;
    for (const Believed &b : believed) {
        if (!b.shown) continue;
        Name &name = now.names[size_t(now.find(b.id) - now.names.cbegin())];
        if (name.shown < oldest) fresh.push_back(&name);
        name.shown = t;
        name.reports = b.recent;
    }
    for (Name *name : fresh) {
        Name *heir_of = nullptr;
        int most = 0;
        for (Name &old : now.names) {
            if (old.shown >= t || old.shown < oldest) continue;  // never shown, or still there
            const int n = shared_reports(name->reports, old.reports);
            if (n > most) {
                most = n;
                heir_of = &old;
            }
        }
        if (!heir_of) continue;
        std::swap(heir_of->identity, name->identity);
        heir_of->shown = -1e300;
    }
    return now;
}

}  // namespace trackfield
