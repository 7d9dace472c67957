// A good set of k sensors out of thousands: greedy, then exchanges of one until none helps.
#pragma once

#include "selection_field.hpp"

namespace trackfield::selection {

template <int D>
class Swaps {
  public:
    Swaps(const Field<D> &field, double ridge) : field_(field), near_(field), ridge_(ridge), taken_(field.n, 0) {}

    // The best next one k times.
    Set greedy(int k) {
        std::fill(taken_.begin(), taken_.end(), uint8_t(0));
        State<D> state = field_.start(std::max(ridge_, kSoft));
        Set set;
        while (int(set.size()) < k) {
            near_.prepare(state);
            int best = -1;
            double value = -INFINITY;
            for (int i = 0; i < field_.n; ++i) {
                if (taken_[i]) continue;
                const double with = near_.with(i, value);
                if (best < 0 || with > value) value = with, best = i;
            }
            taken_[best] = 1;
            set.push_back(best);
            field_.add(state, best);
        }
        return set;
    }

    // Exchange one for another while that helps; the value it ends with.
    double improve(Set &set) {
        std::fill(taken_.begin(), taken_.end(), uint8_t(0));
        for (int32_t i : set) taken_[i] = 1;
        double value = value_of(set);
        for (size_t idle = 0, place = 0; idle < set.size(); place = (place + 1) % set.size()) {
            ++idle;
            near_.prepare(without(set, place));
            int best = -1;
            double found = value + kGain * std::abs(value);
            for (int i = 0; i < field_.n; ++i) {
                if (taken_[i]) continue;
                const double with = near_.with(i, found);
                if (with > found) found = with, best = i;
            }
            if (best < 0) continue;
            const int32_t old = set[place];
            set[place] = best;
            const double now = value_of(set);
            if (!(now > value)) {  // a gain by rounding only
                set[place] = old;
                continue;
            }
            taken_[old] = 0;
            taken_[best] = 1;
            value = now;
            idle = 0;
        }
        return value;
    }

    double value_of(const Set &set) const { return field_.value(without(set, set.size())); }

  private:
    static constexpr double kSoft = 1e-5;   // of a greedy start, whose first sets leave directions free
    static constexpr double kGain = 1e-12;  // a smaller share is rounding

    State<D> without(const Set &set, size_t place) const {
        State<D> state = field_.start(ridge_);
        for (size_t p = 0; p < set.size(); ++p)
            if (p != place) field_.add(state, set[p]);
        return state;
    }

    const Field<D> &field_;
    Neighbourhood<D> near_;
    double ridge_;
    std::vector<uint8_t> taken_;
};

}  // namespace trackfield::selection
