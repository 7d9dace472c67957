// Which move to try, by how many tracks there are: without one a birth, with one neither merge nor switch.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "mcmcda_window.hpp"

namespace trackfield::mcmcda {

class Schedule {
  public:
    explicit Schedule(const std::array<double, kMoves> &weights) {
        for (int kind = 0; kind < 3; ++kind) {
            double sum = 0;
            for (int m = 0; m < kMoves; ++m) {
                const bool can = kind == 2 || m == kBirth || (kind == 1 && m != kMerge && m != kSwitch);
                p_[kind][m] = can ? weights[m] : 0;
                sum += p_[kind][m];
            }
            for (int m = 0; m < kMoves; ++m) {
                p_[kind][m] /= sum;
                log_p_[kind][m] = std::log(p_[kind][m]);
            }
        }
    }

    // The move that a number in (0, 1) stands for.
    Move draw(int tracks, double u) const {
        const std::array<double, kMoves> &p = p_[std::min(tracks, 2)];
        int last = kBirth;
        for (int m = 0; m < kMoves; ++m) {
            if (p[m] == 0) continue;
            last = m;
            if (u < p[m]) break;
            u -= p[m];
        }
        return Move(last);
    }

    double log_of(Move m, int tracks) const { return log_p_[std::min(tracks, 2)][m]; }

  private:
    std::array<std::array<double, kMoves>, 3> p_, log_p_;  // without tracks, with one, with more
};

}  // namespace trackfield::mcmcda
