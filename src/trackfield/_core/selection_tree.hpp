// The best set by a tree of sets, cut off where a linear bound says that nothing better follows.
#pragma once

#include <numeric>

#include "selection_field.hpp"

namespace trackfield::selection {

// merit(S) <= constant + sum over S of score, for every set; what sensors cost and all may cost.
struct Bounded {
    double constant = 0;
    std::vector<double> score;
    const double *costs = nullptr;
    double budget = INFINITY;
};

template <int D>
class Tree {
  public:
    bool complete = true;
    int64_t looked = 0;

    Tree(const Field<D> &field, const Bounded &bound, int k, double ridge)
        : field_(field), bound_(bound), k_(k), order_(field.n), before_(field.n + 1, 0.0), states_(k), last_(field), now_(k) {
        std::iota(order_.begin(), order_.end(), 0);
        std::sort(order_.begin(), order_.end(), [&](int a, int b) { return bound.score[a] > bound.score[b]; });
        for (int p = 0; p < field.n; ++p) before_[p + 1] = before_[p] + std::max(bound.score[order_[p]], 0.0);
        states_[0] = field.start(ridge);
    }

    // Better a set of merit `value` if there is one; at most `work` sets are looked at.
    double improve(Set &set, double value, int64_t work) {
        work_ = work;
        value_ = value;
        best_ = set;
        descend(0, 0, bound_.constant, 0.0);
        set = best_;
        return value_;
    }

  private:
    static constexpr double kSame = 1e-12;  // a smaller share is rounding

    // What sets can reach at most that take sensors from place p on, `more` of them.
    double reach(double so_far, int p, int more) const { return so_far + before_[std::min(p + more, field_.n)] - before_[p]; }
    bool hopeless(double reached) const { return !(reached > value_ + kSame * std::abs(value_)); }
    bool fits(double spent, int sensor) const { return !bound_.costs || spent + bound_.costs[sensor] <= bound_.budget; }

    void descend(int depth, int first, double so_far, double spent) {
        if (depth == k_ - 1) return finish(first, so_far, spent);
        for (int p = first; p < field_.n && complete; ++p) {
            if (hopeless(reach(so_far, p, k_ - depth))) return;
            const int sensor = order_[p];
            if (!fits(spent, sensor)) continue;
            complete = ++looked <= work_;
            now_[depth] = sensor;
            states_[depth + 1] = states_[depth];
            field_.add(states_[depth + 1], sensor);
            const double now = bound_.costs ? spent + bound_.costs[sensor] : 0.0;
            if (bound_.costs) keep(depth + 1, field_.value(states_[depth + 1]));
            descend(depth + 1, p + 1, so_far + bound_.score[sensor], now);
        }
    }
    void finish(int first, double so_far, double spent) {
        last_.prepare(states_[k_ - 1]);
        for (int p = first; p < field_.n; ++p) {
            if (hopeless(reach(so_far, p, 1))) return;
            if (!fits(spent, order_[p])) continue;
            complete = ++looked <= work_;
            if (!complete) return;
            now_[k_ - 1] = order_[p];
            keep(k_, last_.with(order_[p], value_));
        }
    }
    void keep(int size, double value) {
        if (value <= value_) return;
        value_ = value;
        best_.assign(now_.begin(), now_.begin() + size);
    }

    const Field<D> &field_;
    const Bounded &bound_;
    int k_;
    std::vector<int32_t> order_;
    std::vector<double> before_;
    std::vector<State<D>> states_;
    Neighbourhood<D> last_;
    Set now_, best_;
    double value_ = 0;
    int64_t work_ = 0;
};

}  // namespace trackfield::selection
