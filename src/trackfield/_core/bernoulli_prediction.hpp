// From one scan to the next: histories move and may end, targets never seen come and go.
#pragma once

#include "bernoulli_frame.hpp"

namespace trackfield {

inline double normal_cdf(double z) { return 0.5 * std::erfc(-z * 0.7071067811865476); }

// Probability that N(mean, variance) lies between two bounds.
inline double inside(double mean, double variance, double low, double high) {
    const double sigma = std::sqrt(variance);
    if (mean - low > 8 * sigma && high - mean > 8 * sigma) return 1;
    return std::max(0.0, normal_cdf((high - mean) / sigma) - normal_cdf((low - mean) / sigma));
}

// P(alive after n more steps | alive now, first seen `age` steps ago).
inline double lasting(const BernoulliModel &m, double age, double n) {
    if (m.hazard.empty()) return std::pow(m.survival, n);
    const size_t last = m.hazard.size() - 1;
    double s = 1;
    for (double k = 0; k < n && s > 1e-12; ++k) s *= 1 - m.hazard[size_t(std::min(age + k, double(last)))];
    return s;
}

// r <- r s P_in: survival, and inside the region after the move.
inline std::vector<Leaf> predicted(const Frame &frame, const BernoulliModel &m, double dt, double n) {
    std::vector<Leaf> leaves = frame.leaves;
    for (const Track &track : frame.tracks) {
        const double s = lasting(m, std::round((frame.t - track.first) / m.step), n);
        for (int32_t k = track.begin; k < track.end; ++k) {
            Leaf &leaf = leaves[k];
            leaf.parent = k;
            leaf.state.predict(dt / n, n, m.accel_sigma);
            const Plane &p = leaf.state;
            leaf.survival = s * std::pow(m.survival_map.at(p.x, p.y), n) * inside(p.x, p.A.xx, m.region.x_min, m.region.x_max) *
                            inside(p.y, p.A.yy, m.region.y_min, m.region.y_max);
            leaf.existence *= leaf.survival;
        }
    }
    return leaves;
}

// Expected number per area of targets never seen, over cells of the region (one cell where nothing varies).
class Undetected {
  public:
    explicit Undetected(const BernoulliModel &m) : m_(m) {
        grid_.region = m.region;
        auto cover = [&](const Map &map) {
            grid_.rows = std::max(grid_.rows, std::min(map.rows, kMost));
            grid_.columns = std::max(grid_.columns, std::min(map.columns, kMost));
        };
        cover(m.birth_map);
        cover(m.survival_map);
        for (const Map &map : m.p_detection) cover(map);
        const size_t cells = size_t(grid_.rows) * grid_.columns;
        grid_.values.assign(cells, 0.0);
        births_.resize(cells);
        double total = 0;
        for (size_t c = 0; c < cells; ++c) total += births_[c] = m.birth_map.at(x(c), y(c));
        const double cell_area = m.region.area() / double(cells);
        for (double &b : births_) b = total > 0 ? b / (total * cell_area) : 0.0;
    }

    void start() { add(m_.initial_count); }
    void load(const std::vector<double> &values) { grid_.values = values; }
    const std::vector<double> &values() const { return grid_.values; }
    double at(double px, double py) const { return grid_.at(px, py); }

    void predict(double dt, double n, double births) {
        if (!grid_.uniform()) spread(dt);
        const double s = lasting(m_, 0, std::min(n, 1e6));
        for (size_t c = 0; c < grid_.values.size(); ++c)
            grid_.values[c] *= s * std::pow(m_.survival_map.at(x(c), y(c)), n);
        add(births * std::min(n, kMostSteps));
    }

    // Those that a scan would have reported are not among them any more.
    void miss(double p_factor, double p_learned, int age) {
        const size_t ages = m_.p_detection.size();
        const Map *map = ages ? &m_.p_detection[std::min(size_t(age), ages - 1)] : nullptr;
        for (size_t c = 0; c < grid_.values.size(); ++c)
            grid_.values[c] *= 1 - p_factor * (map ? map->at(x(c), y(c)) : p_learned);
    }

  private:
    static constexpr int kMost = 64;
    static constexpr double kMostSteps = 20;  // births in an outage: the earlier ones have mostly ended or left
    const BernoulliModel &m_;
    Map grid_;
    std::vector<double> births_;  // of one target, per area

    double x(size_t c) const {
        return grid_.region.x_min + (double(c % size_t(grid_.columns)) + 0.5) / grid_.columns * (grid_.region.x_max - grid_.region.x_min);
    }
    double y(size_t c) const {
        return grid_.region.y_min + (double(c / size_t(grid_.columns)) + 0.5) / grid_.rows * (grid_.region.y_max - grid_.region.y_min);
    }
    void add(double targets) {
        for (size_t c = 0; c < births_.size(); ++c) grid_.values[c] += targets * births_[c];
    }

    // They move velocity_sigma dt an axis; who crosses the border is gone.
    void spread(double dt) {
        const double w = (grid_.region.x_max - grid_.region.x_min) / grid_.columns, h = (grid_.region.y_max - grid_.region.y_min) / grid_.rows;
        for (int i = 0; i < grid_.rows; ++i) blur(size_t(i) * grid_.columns, 1, grid_.columns, m_.velocity_sigma * dt / w);
        for (int j = 0; j < grid_.columns; ++j) blur(size_t(j), grid_.columns, grid_.rows, m_.velocity_sigma * dt / h);
    }

    // Three-point blur along a line, as often as the width (in cells) asks for.
    void blur(size_t begin, int stride, int length, double sigma) {
        const int rounds = std::clamp(int(std::ceil(std::min(sigma * sigma / 0.6, 30.0))), 1, 30);
        const double a = std::min(sigma * sigma / rounds / 2, 1.0 / 3);
        double *at = grid_.values.data() + begin;
        for (int round = 0; round < rounds; ++round) {
            double before = 0;
            for (int k = 0; k < length; ++k) {
                double &cell = at[size_t(k) * stride];
                const double here = cell, next = k + 1 < length ? at[size_t(k + 1) * stride] : 0;
                cell = (1 - 2 * a) * here + a * (before + next);
                before = here;
            }
        }
    }
};

}  // namespace trackfield
