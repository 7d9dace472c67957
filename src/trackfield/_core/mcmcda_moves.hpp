// The eight moves, each taken with the probability that leaves the posterior unchanged,
// min(1, P(w') q(w | w') / (P(w) q(w' | w))), Oh (14). In `forth` and `back` stand log q(w' | w) and
// log q(w | w').
#pragma once

#include <vector>

#include "mcmcda_births.hpp"
#include "mcmcda_schedule.hpp"
#include "mcmcda_swaps.hpp"

namespace trackfield::mcmcda {

template <class Belief>
class Moves {
  public:
    using Node = mcmcda::Node<Belief>;
    using Track = mcmcda::Track<Belief>;

    Moves(Tracks<Belief> &tracks, Xoshiro &random)
        : window_(tracks.window()), tracks_(tracks), rng_(random), picks_(tracks, random), births_(tracks, picks_, random), schedule_(tracks.window().set.moves) {
        for (Track *t : {&one_, &two_}) *t = tracks_.spare();
    }

    Moves(const Moves &) = delete;
    Moves &operator=(const Moves &) = delete;

    Move draw() { return schedule_.draw(tracks_.count(), rng_.uniform()); }

    // Try a move; whether it was taken.
    bool attempt(Move m) {
        const bool taken = propose(m);
        if (taken) swaps_known_ = merges_known_ = false;
        return taken;
    }

    // Take over tracks; one whose reports may not follow each other is cut there.
    void adopt(const int32_t *owner) {
        std::vector<std::vector<int32_t>> reports(window_.size());
        for (int i = 0; i < window_.size(); ++i)
            if (owner[i] >= 0 && owner[i] < window_.size()) reports[owner[i]].push_back(i);
        for (const std::vector<int32_t> &track : reports) {
            Track t = tracks_.spare();
            for (const int32_t i : track) {
                const Link *link = t.length > 0 ? window_.find(t.last().report, i) : nullptr;
                if (link) {
                    tracks_.grow(t, *link);
                    continue;
                }
                if (t.length > 1) finish(t);
                tracks_.begin(t, i);
            }
            if (t.length > 1) finish(t);
        }
    }

  private:
    const Window &window_;
    Tracks<Belief> &tracks_;
    Xoshiro &rng_;
    Picks<Belief> picks_;
    Births<Belief> births_;
    Track one_, two_;  // proposed
    std::vector<EndStart> merges_;
    std::vector<Swap> swaps_, swaps_after_;
    bool merges_known_ = false, swaps_known_ = false;
    Schedule schedule_;

    bool propose(Move m) {
        switch (m) {
            case kBirth: return birth();
            case kDeath: return death();
            case kSplit: return split();
            case kMerge: return merge();
            case kExtension: return at_start() ? extension_before() : extension();
            case kReduction: return at_start() ? reduction_before() : reduction();
            case kUpdate: return update();
            default: return swap_tails();
        }
    }

    bool take(double log_ratio) { return log_ratio >= 0 || std::log(rng_.uniform()) < log_ratio; }

    // Add a track to the partition, and leave an empty one.
    void finish(Track &t) {
        t.score = tracks_.finished(t.last());
        Track done = tracks_.spare();
        std::swap(done, t);
        tracks_.add(std::move(done));
    }

    // Draw how a track goes on; log probability.
    double draw_suffix(Track &t) {
        double log_q = 0;
        while (const Link *link = picks_.next(t.last(), log_q)) tracks_.grow(t, *link);
        return log_q;
    }

    // Log probability that the suffix process draws the nodes from place `from` on; they must be free.
    double log_suffix(const Track &t, int from) {
        double log_q = 0;
        for (int p = from; p < t.length; ++p) log_q += picks_.log_next(t.nodes[p - 1], t.nodes[p].report);
        return log_q + picks_.log_stop(t.last());
    }

    // Put a proposed track in place of track k.
    void replace(int k, Track &proposed, int from) {
        tracks_.release(k, from);
        std::swap(tracks_[k], proposed);
        tracks_.own(k, from);
    }

    // The moves ------------------------------------------------------------------------------------

    bool birth() {
        int first = 0;
        double log_q = 0;
        const Link *second = births_.draw(first, log_q);
        if (!second) return false;
        tracks_.begin(one_, first);
        tracks_.grow(one_, *second);
        log_q += draw_suffix(one_);
        one_.score = tracks_.finished(one_.last());
        const int K = tracks_.count();
        const double forth = schedule_.log_of(kBirth, K) + log_q;
        const double back = schedule_.log_of(kDeath, K + 1) - std::log(double(K + 1));
        if (!take(one_.score + back - forth)) return false;
        finish(one_);
        return true;
    }

    bool death() {
        const int K = tracks_.count(), k = rng_.below(K);
        const Track &t = tracks_[k];
        if (tracks_.frozen(t) > 0) return false;
        tracks_.release(k, 0);
        const double forth = schedule_.log_of(kDeath, K) - std::log(double(K));
        const double back = schedule_.log_of(kBirth, K - 1) + births_.log_draw(t.nodes[0].report, t.nodes[1].report) + log_suffix(t, 2);
        if (take(back - forth - t.score)) {
            tracks_.remove(k);
            return true;
        }
        tracks_.own(k, 0);
        return false;
    }

    int cuts(const Track &t) const { return tracks_.cuts(t.length, tracks_.frozen(t)); }

    int all_cuts() const {
        int n = 0;
        for (int k = 0; k < tracks_.count(); ++k) n += cuts(tracks_[k]);
        return n;
    }

    const std::vector<EndStart> &merges() {
        if (!merges_known_) list_merges(tracks_, merges_);
        merges_known_ = true;
        return merges_;
    }

    bool split() {
        const int K = tracks_.count(), n = all_cuts();
        if (n == 0) return false;
        int k = 0, at = rng_.below(n);
        while (at >= cuts(tracks_[k])) at -= cuts(tracks_[k++]);
        Track &t = tracks_[k];
        const int cut = std::max(2, tracks_.frozen(t)) + at;
        tracks_.begin(one_, t.nodes[cut].report);
        tracks_.append(one_, t, cut + 1);
        one_.score = tracks_.finished(one_.last());
        const double head = tracks_.finished(t.nodes[cut - 1]);
        const int undo = int(merges().size()) + 1 + starts_after(tracks_, t.nodes[cut - 1].report) +
                         ends_before(tracks_, t.nodes[cut].report);
        const double forth = schedule_.log_of(kSplit, K) - std::log(double(n));
        const double back = schedule_.log_of(kMerge, K + 1) - std::log(double(undo));
        if (!take(head + one_.score - t.score + back - forth)) return false;
        t.length = cut;
        t.score = head;
        finish(one_);
        return true;
    }

    bool merge() {
        const int K = tracks_.count(), n = int(merges().size());
        if (n == 0) return false;
        const EndStart pair = merges()[rng_.below(n)];
        const Track &a = tracks_[pair.before], &b = tracks_[pair.after];
        tracks_.copy_head(one_, a, a.length);
        tracks_.append(one_, b, 0);
        one_.score = tracks_.finished(one_.last());
        const int undo = all_cuts() - cuts(a) - cuts(b) + cuts(one_);
        const double forth = schedule_.log_of(kMerge, K) - std::log(double(n));
        const double back = schedule_.log_of(kSplit, K - 1) - std::log(double(undo));
        if (!take(one_.score - a.score - b.score + back - forth)) return false;
        replace(pair.before, one_, 0);
        tracks_.remove(pair.after);
        return true;
    }

    // Informed extensions and reductions work at either end alike, the uniform ones at the last only.
    bool at_start() { return window_.set.informed && rng_.uniform() < 0.5; }

    bool extension_before() {
        const int K = tracks_.count(), k = rng_.below(K);
        const Track &t = tracks_[k];
        double log_q = 0;
        const int report = picks_.before(t.nodes[0].report, t.nodes[1].report, log_q);
        if (report < 0) return false;
        tracks_.begin(one_, report);
        tracks_.append(one_, t, 0);
        one_.score = tracks_.finished(one_.last());
        const double forth = schedule_.log_of(kExtension, K) + log_q;
        if (!take(one_.score - t.score + schedule_.log_of(kReduction, K) - forth)) return false;
        replace(k, one_, 0);
        return true;
    }

    bool reduction_before() {
        const int K = tracks_.count(), k = rng_.below(K);
        const Track &t = tracks_[k];
        if (tracks_.frozen(t) > 0 || t.length < 3) return false;
        tracks_.begin(one_, t.nodes[1].report);
        tracks_.append(one_, t, 2);
        one_.score = tracks_.finished(one_.last());
        const double back = schedule_.log_of(kExtension, K) + picks_.log_before(t.nodes[1].report, t.nodes[2].report, t.nodes[0].report);
        if (!take(one_.score - t.score + back - schedule_.log_of(kReduction, K))) return false;
        replace(k, one_, 0);
        return true;
    }

    // Ways to shorten a track at its end, two reports and the frozen ones left.
    int reductions(const Track &t) const { return t.length - std::max(2, tracks_.frozen(t)); }

    bool extension() {
        const int K = tracks_.count(), k = rng_.below(K);
        Track &t = tracks_[k];
        const int before = t.length;
        double log_q = 0;
        const Link *link = picks_.forced(t.last(), log_q);
        if (!link) return false;
        tracks_.grow(t, *link);
        log_q += draw_suffix(t);
        const double score = tracks_.finished(t.last());
        const double forth = schedule_.log_of(kExtension, K) + log_q;
        const double back = schedule_.log_of(kReduction, K) - std::log(double(reductions(t)));
        if (!take(score - t.score + back - forth)) {
            t.length = before;
            return false;
        }
        t.score = score;
        tracks_.own(k, before);
        return true;
    }

    bool reduction() {
        const int K = tracks_.count(), k = rng_.below(K);
        Track &t = tracks_[k];
        const int n = reductions(t);
        if (n <= 0) return false;
        const int left = t.length - 1 - rng_.below(n);
        tracks_.release(k, left);
        const double score = tracks_.finished(t.nodes[left - 1]);
        const double forth = schedule_.log_of(kReduction, K) - std::log(double(n));
        const double back = schedule_.log_of(kExtension, K) + picks_.log_forced(t.nodes[left - 1], t.nodes[left].report) + log_suffix(t, left + 1);
        if (!take(score - t.score + back - forth)) {
            tracks_.own(k, left);
            return false;
        }
        t.length = left;
        t.score = score;
        return true;
    }

    // Places from which a track may be drawn afresh.
    int redraws(const Track &t) const { return t.length - std::max(1, tracks_.frozen(t)) + 1; }

    bool update() {
        const int k = rng_.below(tracks_.count());
        Track &t = tracks_[k];
        const int from = t.length - rng_.below(redraws(t));
        tracks_.release(k, from);
        tracks_.copy_head(one_, t, from);
        const double drawn = draw_suffix(one_);
        if (one_.length < 2) {
            tracks_.own(k, from);
            return false;
        }
        one_.score = tracks_.finished(one_.last());
        const double forth = drawn - std::log(double(redraws(t)));
        const double back = log_suffix(t, from) - std::log(double(redraws(one_)));
        const bool taken = take(one_.score - t.score + back - forth);
        if (taken) std::swap(t, one_);
        tracks_.own(k, from);
        return taken;
    }

    const std::vector<Swap> &swaps() {
        if (!swaps_known_) list_swaps(tracks_, swaps_);
        swaps_known_ = true;
        return swaps_;
    }

    bool swap_tails() {
        const int n = int(swaps().size());
        if (n == 0) return false;
        const Swap s = swaps()[rng_.below(n)];
        tracks_.copy_head(one_, tracks_[s.a], s.i);
        tracks_.append(one_, tracks_[s.b], s.j);
        tracks_.copy_head(two_, tracks_[s.b], s.j);
        tracks_.append(two_, tracks_[s.a], s.i);
        one_.score = tracks_.finished(one_.last());
        two_.score = tracks_.finished(two_.last());
        const double log_u = std::log(rng_.uniform());
        const double gain = one_.score + two_.score - tracks_[s.a].score - tracks_[s.b].score;
        if (log_u >= gain + std::log(double(n))) return false;  // whatever the swapped tracks could undo
        exchange(s);
        list_swaps(tracks_, swaps_after_);
        if (log_u < gain + std::log(double(n)) - std::log(double(swaps_after_.size()))) return true;
        exchange(s);
        return false;
    }

    // Put the proposed tracks in place of the two of a swap, or back.
    void exchange(const Swap &s) {
        std::swap(tracks_[s.a], one_);
        std::swap(tracks_[s.b], two_);
        tracks_.own(s.a, s.i);
        tracks_.own(s.b, s.j);
    }
};

}  // namespace trackfield::mcmcda
