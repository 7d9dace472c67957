// Particles: drawing them again by weight, their moments, the sensors that cover them.
#pragma once

#include <algorithm>
#include <cmath>
#include <numeric>

#include "detect_belief.hpp"

namespace trackfield::detect {

inline double total(const std::vector<double> &v) { return std::accumulate(v.begin(), v.end(), 0.0); }

inline void normalize(std::vector<double> &w) {
    const double sum = total(w);
    for (double &v : w) v /= sum;
}

// n places of a list of weights by systematic resampling with the offset u in [0, 1).
inline std::vector<int> systematic(const std::vector<double> &w, int n, double u) {
    std::vector<int> index(n);
    const double all = total(w);
    double sum = w[0];
    size_t j = 0;
    for (int k = 0; k < n; ++k) {
        const double at = (k + u) / n * all;
        while (sum <= at && j + 1 < w.size()) sum += w[++j];
        index[k] = int(j);
    }
    return index;
}

inline std::vector<int> shuffled(Chance &chance, int n) {
    std::vector<int> index(n);
    std::iota(index.begin(), index.end(), 0);
    for (int j = n - 1; j > 0; --j) std::swap(index[j], index[int(chance.uniform(j) * (j + 1))]);
    chance.spend(n);
    return index;
}

template <class T> void gather(std::vector<T> &v, const std::vector<int> &index) {
    std::vector<T> o(index.size());
    for (size_t k = 0; k < index.size(); ++k) o[k] = v[index[k]];
    v = std::move(o);
}

inline void gather(Cloud &c, const std::vector<int> &index) {
    for (auto *axis : {&c.x, &c.y, &c.vx, &c.vy}) gather(*axis, index);
    gather(c.here, index);
    for (std::vector<Point> &step : c.past) gather(step, index);
}

inline double existence(const Group &g, const Member &m) {
    double sum = 0;
    for (size_t j = 0; j < g.weight.size(); ++j) sum += m.cloud.here[j] ? g.weight[j] : 0;
    return sum;
}

inline void count_existence(Group &g) {
    for (Member &m : g.members) m.existence = existence(g, m);
}

// The marginal of a member, given that it exists, with equal weights.
inline Cloud marginal(Chance &chance, const Group &g, const Member &m) {
    std::vector<double> w(g.weight);
    for (size_t j = 0; j < w.size(); ++j) w[j] = m.cloud.here[j] ? w[j] : 0;
    Cloud c = m.cloud;
    gather(c, systematic(w, int(w.size()), chance.uniform(0)));
    chance.spend(1);
    return c;
}

// How surely each sensor covers a member, given that it exists.
class Coverage {
   public:
    explicit Coverage(const CoverageMap &map, size_t sensors)
        : map_(map), in_cell_(map.cells(), 0.0), on_sensor_(sensors, 0.0) {}

    void update(const Group &g, Member &m) {
        const Cloud &c = m.cloud;
        cells_.clear();
        double all = 0;
        for (size_t j = 0; j < c.size(); ++j) {
            if (!c.here[j] || !(g.weight[j] > 0)) continue;
            const int k = map_.at(c.x[j], c.y[j]);
            if (in_cell_[k] == 0) cells_.push_back(k);
            in_cell_[k] += g.weight[j];
            all += g.weight[j];
        }
        m.cover.clear();
        for (int k : cells_) {
            for (const Seen *e = map_.begin(k); e != map_.end(k); ++e) {
                if (on_sensor_[e->sensor] == 0) m.cover.push_back({e->sensor, 0});
                on_sensor_[e->sensor] += e->covered * in_cell_[k];
            }
            in_cell_[k] = 0;
        }
        for (Seen &e : m.cover) {
            e.covered = std::min(1.0, on_sensor_[e.sensor] / all);
            on_sensor_[e.sensor] = 0;
        }
    }

   private:
    const CoverageMap &map_;
    std::vector<double> in_cell_, on_sensor_;
    std::vector<int> cells_;
};

// Mean and covariance of `m`, given that it exists; nothing where it exists in no particle.
inline void moments(const std::vector<double> &weight, const Cloud &c, Member &m) {
    double all = 0, mean[4] = {}, cov[10] = {};
    const std::vector<double> *axis[4] = {&c.x, &c.y, &c.vx, &c.vy};
    for (size_t j = 0; j < c.size(); ++j) {
        if (!c.here[j]) continue;
        all += weight[j];
        for (int d = 0; d < 4; ++d) mean[d] += weight[j] * (*axis[d])[j];
    }
    if (!(all > 0)) return;
    for (int d = 0; d < 4; ++d) m.mean[d] = mean[d] / all;
    for (size_t j = 0; j < c.size(); ++j) {
        if (!c.here[j]) continue;
        double off[4];
        for (int d = 0; d < 4; ++d) off[d] = (*axis[d])[j] - m.mean[d];
        int k = 0;
        for (int d = 0; d < 4; ++d)
            for (int e = d; e < 4; ++e) cov[k++] += weight[j] * off[d] * off[e];
    }
    for (int k = 0; k < 10; ++k) m.cov[k] = cov[k] / all;
}

}  // namespace trackfield::detect
