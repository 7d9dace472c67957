// The Markov chain over partitions, Oh Algorithm 3: it remembers the best partition that it met.
#pragma once

#include <vector>

#include "mcmcda_moves.hpp"

namespace trackfield::mcmcda {

struct Counts {
    std::array<int64_t, kMoves> proposed{}, accepted{};
};

template <class Belief>
class Chain {
  public:
    Xoshiro rng;
    Counts counts;

    // Start at tracks: `owner` is the number of each report's track, -1 of none.
    Chain(const Window &window, const Xoshiro &random, const int32_t *owner)
        : rng(random), tracks_(window), moves_(tracks_, rng) {
        moves_.adopt(owner);
        score_ = tracks_.score();
        remember();
    }

    Chain(const Chain &) = delete;
    Chain &operator=(const Chain &) = delete;

    void step() {
        const Move m = moves_.draw();
        ++counts.proposed[m];
        if (!moves_.attempt(m)) return;
        ++counts.accepted[m];
        score_ = tracks_.score();
        if (score_ > best_score_) remember();
    }

    const Tracks<Belief> &tracks() const { return tracks_; }
    double score() const { return score_; }
    double best_score() const { return best_score_; }
    const std::vector<int32_t> &best() const { return best_; }

    // The score, computed from the partition alone.
    double fresh_score() const {
        double sum = 0;
        for (int k = 0; k < tracks_.count(); ++k) {
            const Track<Belief> &t = tracks_[k];
            Node<Belief> node = tracks_.start(t.nodes[0].report);
            for (int p = 1; p < t.length; ++p)
                node = tracks_.follow(node, *tracks_.window().find(node.report, t.nodes[p].report));
            sum += tracks_.finished(node);
        }
        return sum;
    }

  private:
    Tracks<Belief> tracks_;
    Moves<Belief> moves_;
    double score_ = 0, best_score_ = 0;
    std::vector<int32_t> best_;

    void remember() {
        best_score_ = score_;
        best_ = tracks_.owners();
    }
};

}  // namespace trackfield::mcmcda
