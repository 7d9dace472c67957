// The best set that a budget pays for, and the cheapest set that is good enough.
#pragma once

#include "selection_purse.hpp"
#include "selection_search.hpp"

namespace trackfield::selection {

template <int D>
Bounded bounded_by(const Cut<D> &cut, const Field<D> &field, const double *costs, double budget) {
    Bounded out{cut.constant + cut.price * budget, std::vector<double>(field.n), costs, budget};
    for (int i = 0; i < field.n; ++i) out.score[i] = cut.score(field.gain(i, 0)) - cut.price * costs[i];
    return out;
}

// Best set of at most `most` sensors that costs no more than the budget.
template <int D>
Found<D> best_affordable(const Field<D> &field, int most, double ridge, const double *costs, double budget, int64_t work) {
    Purse<D> purse(field, costs, most, ridge);
    Found<D> found;
    double value = -INFINITY;
    const auto offer = [&](Set set) {
        const double reached = purse.improve(set, budget);
        if (reached > value) value = reached, found.set = set;
    };
    offer(purse.greedy(budget, INFINITY, false));
    offer(purse.greedy(budget, INFINITY, true));
    const Limits limits{2, costs, {double(most), budget}};
    Relaxation<D> relaxed(field, limits, ridge);
    relaxed.solve(1e-5);
    found.cut = relaxed.cut;
    std::vector<int32_t> order(field.n);
    std::iota(order.begin(), order.end(), 0);
    std::sort(order.begin(), order.end(), [&](int a, int b) { return relaxed.share[a] > relaxed.share[b]; });
    Set rounded;
    double spent = 0;
    for (int32_t i : order)
        if (int(rounded.size()) < most && spent + costs[i] <= budget) rounded.push_back(i), spent += costs[i];
    offer(rounded);
    if (!found.cut.sound()) return found;
    const Bounded bounded = bounded_by(found.cut, field, costs, budget);
    Tree<D> tree(field, bounded, most, ridge);
    tree.improve(found.set, value, work);
    found.complete = tree.complete;
    return found;
}

// Cheapest set of at most `most` sensors whose merit is at least a level, among all sets.
template <int D>
class Thrift {
  public:
    bool complete = true;

    // No set that is good enough costs less than `least` + sum of its `rest`: for any multiplier, a
    // set's costs exceed costs + multiplier * (level - what the tangent says that it reaches).
    Thrift(const Field<D> &field, const Cut<D> &cut, double multiplier, int most, double ridge, const double *costs, double level)
        : field_(field), costs_(costs), most_(most), level_(level), order_(field.n), rest_(field.n), before_(field.n + 1, 0.0), states_(most + 1), now_(most) {
        least_ = multiplier * (level - cut.constant);
        bool sound = std::isfinite(least_);
        for (int i = 0; i < field.n; ++i) {
            rest_[i] = costs[i] - multiplier * cut.score(field.gain(i, 0));
            sound = sound && std::isfinite(rest_[i]);
        }
        if (!sound) least_ = 0.0, rest_.assign(costs, costs + field.n);  // the costs themselves bound
        std::iota(order_.begin(), order_.end(), 0);
        std::sort(order_.begin(), order_.end(), [&](int a, int b) { return rest_[a] < rest_[b]; });
        for (int p = 0; p < field.n; ++p) before_[p + 1] = before_[p] + std::min(rest_[order_[p]], 0.0);
        states_[0] = field.start(ridge);
    }
    // What every set costs at least.
    double bound() const { return least_ + before_[std::min(most_, field_.n)]; }

    // A cheaper set than one that costs so much, if there is one.
    double improve(Set &set, double cost, int64_t work) {
        best_ = set;
        cost_ = cost;
        work_ = work;
        descend(0, 0, least_, 0.0);
        set = best_;
        return cost_;
    }

  private:
    static constexpr double kSame = 1e-12;

    void descend(int depth, int first, double so_far, double spent) {
        for (int p = first; p < field_.n && complete; ++p) {
            const double reached = so_far + before_[std::min(p + most_ - depth, field_.n)] - before_[p];
            if (!(reached < cost_ * (1.0 - kSame))) return;
            const int sensor = order_[p];
            const double now = spent + costs_[sensor];
            if (!(now < cost_ * (1.0 - kSame))) continue;
            complete = ++looked_ <= work_;
            now_[depth] = sensor;
            states_[depth + 1] = states_[depth];
            field_.add(states_[depth + 1], sensor);
            if (field_.value(states_[depth + 1]) >= level_) {
                cost_ = now;
                best_.assign(now_.begin(), now_.begin() + depth + 1);
            } else if (depth + 1 < most_) {
                descend(depth + 1, p + 1, so_far + rest_[sensor], now);
            }
        }
    }

    const Field<D> &field_;
    const double *costs_;
    int most_;
    double level_, least_ = 0, cost_ = 0;
    std::vector<int32_t> order_;
    std::vector<double> rest_, before_;
    std::vector<State<D>> states_;
    Set now_, best_;
    int64_t work_ = 0, looked_ = 0;
};

template <int D>
struct Cheapest {
    Set set;
    double bound = 0;  // no set that is good enough costs less
    bool complete = false;
};

// `able` is a set that is good enough.
template <int D>
Cheapest<D> cheapest(const Field<D> &field, Set able, int most, double ridge, const double *costs, double level, int64_t work) {
    constexpr int kHalvings = 14;
    Purse<D> purse(field, costs, most, ridge);
    Cheapest<D> found{able};
    purse.cheapen(found.set, level);
    double cost = purse.cost_of(found.set);
    for (const bool for_its_cost : {false, true}) {
        Set set = purse.greedy(INFINITY, level, for_its_cost);
        if (!(purse.value_of(set) >= level)) continue;
        purse.cheapen(set, level);
        if (purse.cost_of(set) < cost) cost = purse.cost_of(set), found.set = set;
    }
    // The budget for which shares are just good enough prices a unit of merit.
    double low = 0, high = cost, multiplier = 0;
    Cut<D> best;
    for (int halving = 0; halving < kHalvings && cost > 0; ++halving) {
        const double budget = 0.5 * (low + high);
        Relaxation<D> relaxed(field, Limits{2, costs, {double(most), budget}}, ridge);
        relaxed.solve(1e-5);
        (relaxed.value >= level ? high : low) = budget;
        if (!relaxed.cut.sound() || !(relaxed.cut.price > 0)) continue;
        const Thrift<D> trial(field, relaxed.cut, 1.0 / relaxed.cut.price, most, ridge, costs, level);
        if (trial.bound() > found.bound || multiplier == 0) found.bound = trial.bound(), multiplier = 1.0 / relaxed.cut.price, best = relaxed.cut;
    }
    found.bound = std::max(found.bound, 0.0);
    Thrift<D> tree(field, best, multiplier, most, ridge, costs, level);
    tree.improve(found.set, cost, work);
    found.complete = tree.complete;
    return found;
}

}  // namespace trackfield::selection
