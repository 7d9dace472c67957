// The suffix process S: how a proposed track goes on, report by report, and how probable that was.
//
// Uniform: stop with gamma; else look d ~ zeta slots ahead and take any free report there that may
// follow; stop if there is none. Informed: every free report that may follow is weighed by the
// posterior odds that it would bring, the stop by the probability of silence.
#pragma once

#include <cmath>
#include <vector>

#include "mcmcda_tracks.hpp"
#include "xoshiro.hpp"

namespace trackfield::mcmcda {

constexpr double kLeastWeight = 1e-4;  // of an informed pick, so that none is impossible
constexpr double kLeastStop = 1e-2;
constexpr double kLeastPair = 1e-9;
constexpr double kNowhere = 60;        // squared distance at which a density is below the least weight

template <class Belief>
class Picks {
  public:
    using Node = mcmcda::Node<Belief>;

    Picks(const Tracks<Belief> &tracks, Xoshiro &rng) : tracks_(tracks), window_(tracks.window()), rng_(rng) {
        for (const double z : window_.set.gaps) log_gap_.push_back(std::log(z));
        log_go_ = std::log(1 - window_.set.stop);
    }

    // What follows when something must; null if nothing drawn could. Adds to `log_q`.
    const Link *forced(const Node &node, double &log_q) {
        if (!window_.set.informed) return uniform(node.report, log_q);
        const double total = weigh(node);
        return total > 0 ? weighed(total, log_q) : nullptr;
    }

    // What follows; null to stop. Adds to `log_q`.
    const Link *next(const Node &node, double &log_q) {
        if (window_.set.informed) {
            const double stop = stop_weight(node.report), total = weigh(node);
            if (rng_.uniform() * (stop + total) >= stop) {
                log_q += std::log(total / (stop + total));
                return weighed(total, log_q);
            }
            log_q += std::log(stop / (stop + total));
            return nullptr;
        }
        double picked = 0;
        const Link *link = rng_.uniform() < window_.set.stop ? nullptr : uniform(node.report, picked);
        log_q += link ? log_go_ + picked : log_stop(node);
        return link;
    }

    // Log probability of what `forced` and `next` would do; the reports must be free.
    double log_forced(const Node &node, int to) {
        if (!window_.set.informed) return log_uniform(node.report, to);
        const double total = weigh(node);
        return std::log(weight_of(to) / total);
    }

    double log_next(const Node &node, int to) {
        if (!window_.set.informed) return log_go_ + log_uniform(node.report, to);
        const double total = weigh(node);
        return std::log(weight_of(to) / (total + stop_weight(node.report)));
    }

    double log_stop(const Node &node) {
        if (window_.set.informed) {
            const double stop = stop_weight(node.report);
            return std::log(stop / (stop + weigh(node)));
        }
        double empty = 0;
        for (int d = 1; d <= window_.reach(); ++d)
            if (!any_free(node.report, d)) empty += window_.set.gaps[d - 1];
        return std::log(window_.set.stop + (1 - window_.set.stop) * empty);
    }

    // Which report may go before the first two of a track, weighed; -1 if there is none. Adds to `log_q`.
    int before(int first, int second, double &log_q) {
        const double total = weigh_before(first, second, -1);
        return total > 0 ? weighed(total, log_q)->to : -1;
    }

    // Log probability that `before` gives this report, were it free.
    double log_before(int first, int second, int report) {
        const double total = weigh_before(first, second, report);
        return std::log(weight_of(report) / total);
    }

    // Posterior odds that a report brings which follows.
    double odds(const Node &node, const Link &l) const {
        const Report &r = window_.reports[l.to];
        double norm;
        const double d2 = node.belief.distance2(r, window_.gap(window_.reports[node.report].slot, r.slot), norm);
        return d2 < kNowhere ? l.factor * std::exp(-0.5 * d2) / norm : 0;
    }

    // Distance to look ahead, drawn from zeta.
    int draw_gap() {
        double u = rng_.uniform();
        const std::vector<double> &zeta = window_.set.gaps;
        int d = 1;
        while (d < window_.reach() && u >= zeta[d - 1]) u -= zeta[d++ - 1];
        return d;
    }

    double log_gap(int d) const { return log_gap_[d - 1]; }

    bool any_free(int i, int d) const {
        for (const Link &l : window_.after(i, d))
            if (tracks_.free(l.to)) return true;
        return false;
    }

    // Any free report d slots ahead that may follow, all alike; null if there is none.
    const Link *uniform_at(int i, int d, double &log_q) {
        int n = count_free(i, d);
        if (n == 0) return nullptr;
        log_q -= std::log(double(n));
        n = rng_.below(n);
        for (const Link &l : window_.after(i, d))
            if (tracks_.free(l.to) && n-- == 0) return &l;
        return nullptr;
    }

    int count_free(int i, int d) const {
        int n = 0;
        for (const Link &l : window_.after(i, d)) n += tracks_.free(l.to);
        return n;
    }

  private:
    struct Candidate {
        const Link *link;
        double weight;
    };

    const Tracks<Belief> &tracks_;
    const Window &window_;
    Xoshiro &rng_;
    std::vector<double> log_gap_;
    double log_go_;
    std::vector<Candidate> candidates_;
    std::vector<Link> earlier_;  // candidates to go before a track

    const Link *uniform(int i, double &log_q) {
        const int d = draw_gap();
        log_q += log_gap(d);
        return uniform_at(i, d, log_q);
    }

    double log_uniform(int i, int to) const {
        const int d = window_.reports[to].slot - window_.reports[i].slot;
        return log_gap(d) - std::log(double(count_free(i, d)));
    }

    double stop_weight(int i) const { return std::max(window_.silence(i), kLeastStop); }

    // Candidates to go before a track; `also` counts as free.
    double weigh_before(int first, int second, int also) {
        candidates_.clear();
        double total = 0;
        earlier_.clear();
        for (const int32_t h : window_.before(first))
            if (tracks_.free(h) || h == also) earlier_.push_back({h, 0, 0});
        for (const Link &early : earlier_) {
            const Node node = tracks_.start(early.to);
            const Link &link = *window_.find(early.to, first);
            double weight = std::exp(window_.first(early.to)) * odds(node, link);
            if (weight > 0) weight *= odds(tracks_.follow(node, link), *window_.find(first, second));
            candidates_.push_back({&early, weight + kLeastPair});
            total += weight + kLeastPair;
        }
        return total;
    }

    double weigh(const Node &node) {
        candidates_.clear();
        double total = 0;
        for (const Link &l : window_.after(node.report)) {
            if (!tracks_.free(l.to)) continue;
            const double weight = kLeastWeight + odds(node, l);
            candidates_.push_back({&l, weight});
            total += weight;
        }
        return total;
    }

    const Link *weighed(double total, double &log_q) {
        double u = rng_.uniform() * total;
        size_t c = 0;
        while (c + 1 < candidates_.size() && u >= candidates_[c].weight) u -= candidates_[c++].weight;
        log_q += std::log(candidates_[c].weight / total);
        return candidates_[c].link;
    }

    double weight_of(int to) const {
        for (const Candidate &c : candidates_)
            if (c.link->to == to) return c.weight;
        return 0;
    }
};

}  // namespace trackfield::mcmcda
