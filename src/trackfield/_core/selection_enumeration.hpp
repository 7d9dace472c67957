// The best of all sets of k sensors, by looking at each.
#pragma once

#include "selection_field.hpp"

namespace trackfield::selection {

template <int D>
class Enumeration {
  public:
    Enumeration(const Field<D> &field, int k, double ridge) : field_(field), k_(k), states_(k), last_(field), now_(k) {
        states_[0] = field.start(ridge);
    }
    Set best() {
        value_ = -INFINITY;
        descend(0, 0);
        return best_;
    }

  private:
    void descend(int depth, int first) {
        if (depth == k_ - 1) return finish(first);
        for (int i = first; i <= field_.n - (k_ - depth); ++i) {
            now_[depth] = i;
            states_[depth + 1] = states_[depth];
            field_.add(states_[depth + 1], i);
            descend(depth + 1, i + 1);
        }
    }
    void finish(int first) {
        last_.prepare(states_[k_ - 1]);
        for (int i = first; i < field_.n; ++i) {
            const double value = last_.with(i, value_);
            if (value <= value_) continue;
            value_ = value;
            now_[k_ - 1] = i;
            best_ = now_;
        }
    }

    const Field<D> &field_;
    int k_;
    std::vector<State<D>> states_;
    Neighbourhood<D> last_;
    Set now_, best_;
    double value_ = 0;
};

}  // namespace trackfield::selection
