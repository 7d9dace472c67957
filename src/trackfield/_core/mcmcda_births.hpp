// Where a track may begin: the first two reports of a birth, and how probable that choice was.
//
// Uniform: the first slot and the gap are drawn, then any free report that has a free follower there,
// then any such follower. Informed: among all free pairs that may follow each other, by a weight that
// is the posterior odds of the pair times what could follow it, less where it could go on backwards.
#pragma once

#include <vector>

#include "mcmcda_picks.hpp"

namespace trackfield::mcmcda {

constexpr size_t kMostLookahead = 500000;  // pairs of links that looking ahead may cost

template <class Belief>
class Births {
  public:
    using Node = mcmcda::Node<Belief>;

    Births(Tracks<Belief> &tracks, Picks<Belief> &picks, Xoshiro &rng)
        : tracks_(tracks), window_(tracks.window()), picks_(picks), rng_(rng) {
        if (!window_.set.informed) return;
        weigh_pairs();
        sum_.assign(window_.size(), 0);
        stale_.assign(window_.size(), 1);
    }

    // First report `first` and the link to the second; null if there is none. Sets `log_q`.
    const Link *draw(int &first, double &log_q) {
        if (slots() < 1) return nullptr;
        if (window_.set.informed) return draw_informed(first, log_q);
        const int slot = window_.set.frozen + rng_.below(slots()), d = picks_.draw_gap();
        const int n = starts(slot, d);
        if (n == 0) return nullptr;
        int at = rng_.below(n);
        for (first = window_.slot_begin[slot];; ++first)
            if (is_start(first, d) && at-- == 0) break;
        log_q = log_uniform(d, n);
        return picks_.uniform_at(first, d, log_q);
    }

    // Log probability that `draw` gives these two; both must be free.
    double log_draw(int first, int second) {
        if (window_.set.informed) {
            const double all = total();
            return std::log(pair_[window_.number(*window_.find(first, second))] / all);
        }
        const int slot = window_.reports[first].slot, d = window_.reports[second].slot - slot;
        return log_uniform(d, starts(slot, d)) - std::log(double(picks_.count_free(first, d)));
    }

  private:
    Tracks<Belief> &tracks_;
    const Window &window_;
    Picks<Belief> &picks_;
    Xoshiro &rng_;
    std::vector<double> pair_;  // weight of every link as the start of a track
    std::vector<double> sum_;   // over the free followers of a report
    std::vector<char> stale_;   // whether that sum must be computed afresh

    int slots() const { return window_.slots() - 1 - window_.set.frozen; }

    double log_uniform(int d, int starts) const {
        return picks_.log_gap(d) - std::log(double(slots()) * double(starts));
    }

    bool is_start(int i, int d) const { return tracks_.free(i) && picks_.any_free(i, d); }

    int starts(int slot, int d) const {
        int n = 0;
        for (int i = window_.slot_begin[slot]; i < window_.slot_begin[slot + 1]; ++i) n += is_start(i, d);
        return n;
    }

    const Link *draw_informed(int &first, double &log_q) {
        const double all = total();
        if (!(all > 0)) return nullptr;
        double u = rng_.uniform() * all;
        const Link *drawn = nullptr;
        for (int i = 0; i < window_.size(); ++i) {
            if (!tracks_.free(i) || sum_[i] <= 0) continue;
            if (u >= sum_[i]) {
                u -= sum_[i];
                continue;
            }
            for (const Link &l : window_.after(i)) {
                if (!tracks_.free(l.to)) continue;
                first = i;
                drawn = &l;
                const double weight = pair_[window_.number(l)];
                if (u < weight) break;
                u -= weight;
            }
            break;
        }
        if (drawn) log_q = std::log(pair_[window_.number(*drawn)] / all);
        return drawn;
    }

    // Weight of all free pairs; sums whose reports changed hands are made anew, so nothing drifts.
    double total() {
        for (const int32_t i : tracks_.touched())
            for (const int32_t h : window_.before(i)) stale_[h] = 1;
        tracks_.settled();
        double all = 0;
        for (int i = 0; i < window_.size(); ++i) {
            if (!tracks_.free(i)) continue;
            if (stale_[i]) refresh(i);
            all += sum_[i];
        }
        return all;
    }

    void refresh(int i) {
        double sum = 0;
        for (const Link &l : window_.after(i))
            if (tracks_.free(l.to)) sum += pair_[window_.number(l)];
        sum_[i] = sum;
        stale_[i] = 0;
    }

    void weigh_pairs() {
        const int n = window_.size();
        pair_.assign(window_.links(), 0);
        std::vector<double> backwards(n, 0);
        size_t cost = 0;
        for (int i = 0; i < n; ++i)
            for (const Link &l : window_.after(i)) {
                const Links further = window_.after(l.to);
                cost += further.last - further.first;
            }
        for (int i = 0; i < n; ++i) {
            const Node node = tracks_.start(i);
            for (const Link &l : window_.after(i)) {
                const double odds = picks_.odds(node, l);
                backwards[l.to] += odds;
                pair_[window_.number(l)] = odds * (cost > kMostLookahead || odds <= 0 ? 1 : ahead(tracks_.follow(node, l)));
            }
        }
        for (int i = 0; i < n; ++i)
            for (const Link &l : window_.after(i)) {
                double &weight = pair_[window_.number(l)];
                weight = kLeastPair + std::exp(window_.first(i)) * weight / (1 + backwards[i]);
            }
    }

    double ahead(const Node &node) const {
        double sum = window_.silence(node.report);
        for (const Link &l : window_.after(node.report)) sum += picks_.odds(node, l);
        return sum;
    }
};

}  // namespace trackfield::mcmcda
