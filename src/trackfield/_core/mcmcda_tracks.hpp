// A partition of a window's reports into tracks and false alarms, with everything that scoring a move
// needs again kept at hand: beliefs and partial scores after each report of each track.
#pragma once

#include <utility>
#include <vector>

#include "mcmcda_window.hpp"

namespace trackfield::mcmcda {

// A report of a track: belief after it, and the log posterior of the track up to it, less its end.
template <class Belief>
struct Node {
    int32_t report;
    double prefix;
    Belief belief;
};

template <class Belief>
struct Track {
    int length = 0;
    double score = 0;  // log posterior of the track against its reports being false alarms
    std::vector<Node<Belief>> nodes;

    const Node<Belief> &last() const { return nodes[length - 1]; }
};

template <class Belief>
class Tracks {
  public:
    using Node = mcmcda::Node<Belief>;
    using Track = mcmcda::Track<Belief>;

    explicit Tracks(const Window &window) : window_(window), owner_(window.size(), -1), place_(window.size(), 0) {}

    const Window &window() const { return window_; }
    int count() const { return int(live_.size()); }
    Track &operator[](int k) { return pool_[live_[k]]; }
    const Track &operator[](int k) const { return pool_[live_[k]]; }

    // Number of the track that has report i, -1 of none; and where in it.
    int owner(int i) const { return owner_[i] < 0 ? -1 : position_[owner_[i]]; }
    int place(int i) const { return place_[i]; }
    bool free(int i) const { return owner_[i] < 0 && window_.reports[i].slot >= window_.set.frozen; }

    double score() const {
        double sum = 0;
        for (const int t : live_) sum += pool_[t].score;
        return sum;
    }

    // Reports of a track that lie in the frozen part; they come first.
    int frozen(const Track &t) const {
        int n = 0;
        while (n < t.length && window_.reports[t.nodes[n].report].slot < window_.set.frozen) ++n;
        return n;
    }

    // Ways to cut a track into two of at least two reports.
    int cuts(int length, int frozen) const { return std::max(0, length - 1 - std::max(2, frozen)); }

    Node start(int i) const {
        return {i, window_.first(i), Belief::first(window_.reports[i], window_.set.velocity_variance)};
    }

    Node follow(const Node &node, const Link &link) const {
        const Report &r = window_.reports[link.to];
        Node next{link.to, node.prefix + link.constant, node.belief};
        next.belief.predict(window_.gap(window_.reports[node.report].slot, r.slot));
        next.prefix += next.belief.update(r);
        return next;
    }

    void begin(Track &t, int report) const {
        t.nodes[0] = start(report);
        t.length = 1;
    }

    void grow(Track &t, const Link &link) const {
        t.nodes[t.length] = follow(t.last(), link);
        ++t.length;
    }

    // Go on with the reports of another track from place `from` on.
    void append(Track &t, const Track &other, int from) const {
        for (int p = from; p < other.length; ++p) grow(t, *window_.find(t.last().report, other.nodes[p].report));
    }

    void copy_head(Track &t, const Track &other, int length) const {
        std::copy(other.nodes.begin(), other.nodes.begin() + length, t.nodes.begin());
        t.length = length;
    }

    double finished(const Node &node) const { return node.prefix + window_.ending(node.report, node.belief); }

    // A track that is not part of the partition yet; it has room for a report a slot.
    Track spare() {
        Track t;
        if (!spares_.empty()) {
            std::swap(t, spares_.back());
            spares_.pop_back();
        }
        t.nodes.resize(window_.slots());
        t.length = 0;
        return t;
    }

    void add(Track &&track) {
        int at = int(pool_.size());
        if (vacant_.empty()) {
            pool_.emplace_back();
            position_.push_back(0);
        } else {
            at = vacant_.back();
            vacant_.pop_back();
        }
        position_[at] = count();
        live_.push_back(at);
        pool_[at] = std::move(track);
        own(count() - 1, 0);
    }

    // Drop a track whose reports are nobody's or another track's.
    void remove(int k) {
        const int at = live_[k];
        spares_.push_back(std::move(pool_[at]));
        pool_[at] = Track{};
        vacant_.push_back(at);
        live_[k] = live_.back();
        position_[live_[k]] = k;
        live_.pop_back();
    }

    // Make the reports of track k from place `from` on its own, or nobody's.
    void own(int k, int from) { mark(k, from, live_[k]); }
    void release(int k, int from) { mark(k, from, -1); }

    // Reports whose ownership changed since the last call of `settled`.
    const std::vector<int32_t> &touched() const { return touched_; }
    void settled() { touched_.clear(); }

    // Number of the track of every report, counted from 0 in the order of first reports; -1: none.
    std::vector<int32_t> owners() const {
        std::vector<int32_t> number(pool_.size(), -1), out(window_.size(), -1);
        int32_t next = 0;
        for (int i = 0; i < window_.size(); ++i) {
            if (owner_[i] < 0) continue;
            int32_t &mine = number[owner_[i]];
            if (mine < 0) mine = next++;
            out[i] = mine;
        }
        return out;
    }

  private:
    const Window &window_;
    std::vector<Track> pool_, spares_;
    std::vector<int> live_, vacant_, position_;  // position_: of a track of the pool in live_
    std::vector<int32_t> owner_, place_, touched_;

    void mark(int k, int from, int32_t owner) {
        const Track &t = pool_[live_[k]];
        for (int p = from; p < t.length; ++p) {
            const int32_t i = t.nodes[p].report;
            owner_[i] = owner;
            place_[i] = p;
            if (window_.set.informed) touched_.push_back(i);
        }
    }
};

}  // namespace trackfield::mcmcda
