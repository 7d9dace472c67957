// Sets that cost: exchanges of sensors under a budget, and down to the cheapest that is good enough.
#pragma once

#include "selection_field.hpp"

namespace trackfield::selection {

template <int D>
class Purse {
  public:
    Purse(const Field<D> &field, const double *costs, int most, double ridge) : field_(field), near_(field), costs_(costs), most_(most), ridge_(ridge) {}

    // Take what helps most, for its cost or at all, while it fits and the set is not good enough.
    Set greedy(double budget, double level, bool for_its_cost) const {
        Neighbourhood<D> near(field_);
        State<D> state = field_.start(std::max(ridge_, kSoft));
        Set set;
        double spent = 0, value = field_.value(state);
        while (int(set.size()) < most_ && !(value >= level)) {
            near.prepare(state);
            int best = -1;
            double gain = 0;
            for (int i = 0; i < field_.n; ++i) {
                if (spent + costs_[i] > budget || holds(set, i)) continue;
                double found = near.with(i, -INFINITY) - value;
                if (for_its_cost) found /= std::max(costs_[i], 1e-300);
                if (found > gain || (best < 0 && found >= gain)) gain = found, best = i;
            }
            if (best < 0) break;
            set.push_back(best);
            spent += costs_[best];
            field_.add(state, best);
            value = field_.value(state);
        }
        return set;
    }

    // Add and exchange while that makes the set better within the budget; the value it ends with.
    double improve(Set &set, double budget) {
        double value = value_of(set);
        for (int round = 0; round < kRounds; ++round) {
            const double spent = cost_of(set);
            Move move;
            double found = value + kGain * std::abs(value);
            for (size_t place = 0; place <= set.size(); ++place) {
                const bool adds = place == set.size();
                if (adds && int(set.size()) == most_) continue;
                const double left = budget - spent + (adds ? 0.0 : costs_[set[place]]);
                near_.prepare(without(set, place));
                for (int i = 0; i < field_.n; ++i) {
                    if (costs_[i] > left || holds(set, i)) continue;
                    const double with = near_.with(i, found);
                    if (with > found) found = with, move = {int(place), i};
                }
            }
            if (move.sensor < 0) break;
            apply(move, set);
            value = value_of(set);
        }
        return value;
    }

    // Leave out and exchange while that makes the set cheaper and keeps it good enough.
    void cheapen(Set &set, double level) {
        for (int round = 0; round < kRounds; ++round) {
            Move move;
            double saved = kGain * cost_of(set);
            for (size_t place = 0; place < set.size(); ++place) {
                const State<D> rest = without(set, place);
                const double own = costs_[set[place]];
                if (own > saved && field_.value(rest) >= level) saved = own, move = {int(place), -1};
                near_.prepare(rest);
                for (int i = 0; i < field_.n; ++i)
                    if (own - costs_[i] > saved && !holds(set, i) && near_.with(i, level) >= level) saved = own - costs_[i], move = {int(place), i};
            }
            if (move.place < 0) break;
            apply(move, set);
        }
    }

    double value_of(const Set &set) const { return field_.value(field_.state_of(set, ridge_)); }
    double cost_of(const Set &set) const {
        double sum = 0;
        for (int32_t i : set) sum += costs_[i];
        return sum;
    }

  private:
    struct Move {
        int place = -1, sensor = -1;  // a place behind the last one adds, no sensor leaves out
    };
    static constexpr double kSoft = 1e-5, kGain = 1e-12;
    static constexpr int kRounds = 1000;

    static bool holds(const Set &set, int sensor) { return std::find(set.begin(), set.end(), sensor) != set.end(); }
    static void apply(Move move, Set &set) {
        if (move.place == int(set.size())) {
            set.push_back(move.sensor);
        } else if (move.sensor < 0) {
            set.erase(set.begin() + move.place);
        } else {
            set[move.place] = move.sensor;
        }
    }
    State<D> without(const Set &set, size_t place) const {
        State<D> state = field_.start(ridge_);
        for (size_t p = 0; p < set.size(); ++p)
            if (p != place) field_.add(state, set[p]);
        return state;
    }

    const Field<D> &field_;
    Neighbourhood<D> near_;
    const double *costs_;
    int most_;
    double ridge_;
};

}  // namespace trackfield::selection
