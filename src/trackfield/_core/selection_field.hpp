// The sensors to choose from: what each says of the target, at every place the target may be.
#pragma once

#include <cstdint>
#include <vector>

#include "selection_merit.hpp"

namespace trackfield::selection {

using Set = std::vector<int32_t>;

// Information of `places` places, of which place s has probability weight[s].
template <int D>
using State = std::vector<Packed<D>>;

template <int D>
struct Field {
    int n = 0, places = 0;
    Criterion criterion = Criterion::kTrace;
    std::vector<double> gains;   // [sensor][place][D]
    std::vector<Packed<D>> outer;  // [sensor][place]
    std::vector<double> weight;
    State<D> prior;
    double scale = 0;  // largest |g|^2

    Field(const double *g, const double *priors, const double *weights, int sensors, int s, Criterion c)
        : n(sensors), places(s), criterion(c), gains(size_t(sensors) * s * D), outer(size_t(sensors) * s), weight(weights, weights + s), prior(s) {
        for (int place = 0; place < s; ++place) {
            for (int i = 0; i < n; ++i) {
                const double *from = g + (size_t(place) * n + i) * D;
                std::copy(from, from + D, gains.data() + (size_t(i) * s + place) * D);
                outer[size_t(i) * s + place].add_outer(from);
                scale = std::max(scale, outer[size_t(i) * s + place].trace());
            }
            for (int i = 0; i < D; ++i)
                for (int j = 0; j <= i; ++j) prior[place](i, j) = priors[(size_t(place) * D + i) * D + j];
        }
    }
    // Some of the sensors, in this order.
    Field part(const Set &ids) const {
        Field out(*this, int(ids.size()));
        for (size_t i = 0; i < ids.size(); ++i) {
            std::copy_n(gain(ids[i], 0), places * D, out.gains.data() + i * places * D);
            std::copy_n(&at(ids[i], 0), places, out.outer.data() + i * places);
        }
        return out;
    }
    // Free directions get this little information, so that a set that leaves fewer free is better.
    State<D> start(double ridge) const {
        State<D> state = prior;
        for (Packed<D> &m : state)
            for (int i = 0; i < D; ++i) m(i, i) += ridge * scale;
        return state;
    }
    const double *gain(int sensor, int place) const { return gains.data() + (size_t(sensor) * places + place) * D; }
    const Packed<D> &at(int sensor, int place) const { return outer[size_t(sensor) * places + place]; }

    void add(State<D> &state, int sensor) const {
        for (int s = 0; s < places; ++s) state[s].add(at(sensor, s));
    }
    State<D> state_of(const Set &set, double ridge) const {
        State<D> state = start(ridge);
        for (int32_t i : set) add(state, i);
        return state;
    }
    double value(const State<D> &state) const {
        double total = 0;
        for (int s = 0; s < places; ++s) total += weight[s] * merit(state[s], criterion);
        return total;
    }

  private:
    Field(const Field &whole, int sensors)
        : n(sensors), places(whole.places), criterion(whole.criterion), gains(size_t(sensors) * places * D), outer(size_t(sensors) * places), weight(whole.weight), prior(whole.prior), scale(whole.scale) {}
};

// A set, and what each sensor more makes of it.
template <int D>
class Neighbourhood {
  public:
    explicit Neighbourhood(const Field<D> &field) : field_(field), bases_(field.places) {}
    void prepare(const State<D> &state) {
        for (int s = 0; s < field_.places; ++s) bases_[s].prepare(state[s], field_.criterion);
    }
    // Value with one sensor more, or anything less than `floor` if it is that.
    double with(int sensor, double floor) const {
        if (field_.places == 1) return field_.weight[0] * bases_[0].with(field_.gain(sensor, 0), field_.at(sensor, 0), floor / field_.weight[0]);
        double total = 0;
        for (int s = 0; s < field_.places; ++s) total += field_.weight[s] * bases_[s].with(field_.gain(sensor, s), field_.at(sensor, s), -INFINITY);
        return total;
    }

  private:
    const Field<D> &field_;
    std::vector<Base<D>> bases_;
};

}  // namespace trackfield::selection
