// The pairs that merge and switch choose from, counted.
#pragma once

#include <vector>

#include "mcmcda_tracks.hpp"

namespace trackfield::mcmcda {

struct EndStart {
    int before, after;  // tracks: the first one may be followed by the second
};

// Tail of track a from place i against tail of track b from place j.
struct Swap {
    int a, i, b, j;
};

template <class Belief>
void list_merges(const Tracks<Belief> &tracks, std::vector<EndStart> &out) {
    const Window &w = tracks.window();
    out.clear();
    for (int a = 0; a < tracks.count(); ++a)
        for (const Link &l : w.after(tracks[a].last().report)) {
            const int b = tracks.owner(l.to);
            if (b >= 0 && tracks.place(l.to) == 0 && w.reports[l.to].slot >= w.set.frozen) out.push_back({a, b});
        }
}

// Merges that a new end brings, among the tracks that are there.
template <class Belief>
int starts_after(const Tracks<Belief> &tracks, int end) {
    int n = 0;
    const Window &w = tracks.window();
    for (const Link &l : w.after(end))
        n += tracks.owner(l.to) >= 0 && tracks.place(l.to) == 0 && w.reports[l.to].slot >= w.set.frozen;
    return n;
}

// Merges that a new start brings, among the tracks that are there.
template <class Belief>
int ends_before(const Tracks<Belief> &tracks, int start) {
    int n = 0;
    for (int a = 0; a < tracks.count(); ++a) n += tracks.window().find(tracks[a].last().report, start) != nullptr;
    return n;
}

// Every pair of tails that may change places: each may follow the other's head.
template <class Belief>
void list_swaps(const Tracks<Belief> &tracks, std::vector<Swap> &out) {
    const Window &w = tracks.window();
    out.clear();
    for (int a = 0; a < tracks.count(); ++a)
        for (int i = 1; i < tracks[a].length; ++i) {
            const int tail = tracks[a].nodes[i].report;
            if (w.reports[tail].slot < w.set.frozen) continue;
            for (const Link &l : w.after(tracks[a].nodes[i - 1].report)) {
                const int b = tracks.owner(l.to), j = tracks.place(l.to);
                if (b <= a || j == 0 || w.reports[l.to].slot < w.set.frozen) continue;
                if (w.find(tracks[b].nodes[j - 1].report, tail)) out.push_back({a, i, b, j});
            }
        }
}

}  // namespace trackfield::mcmcda
