// Targets that appear. Those not yet singled out are a Poisson density over places and velocities,
// which the scans raise and lower as they would a target there; where it has grown, it becomes a
// member with particles. So a weak beginning is neither forgotten nor costs a cloud of its own.
#pragma once

#include "detect_evidence.hpp"

namespace trackfield::detect {

constexpr int kSpeeds = 5;  // velocities per axis
constexpr int kVelocities = kSpeeds * kSpeeds;
constexpr double kSpacing = 0.8;  // of the velocities, in sigmas

struct Newborn {
    Cloud cloud;
    std::vector<double> weight;  // sum: the odds that it is there before the scan
    double told = 0;             // the odds after it, seen alone
    double x = 0, y = 0;
};

class Births {
   public:
    Births(const Settings &settings, const CoverageMap &map) : s(settings), map_(map) {
        rows_ = (map_.rows + s.birth_stride - 1) / s.birth_stride;
        columns_ = (map_.columns + s.birth_stride - 1) / s.birth_stride;
        width_ = s.birth_stride * map_.cell;
        double all = 0;
        for (int v = 0; v < kVelocities; ++v) {
            vx_[v] = (v % kSpeeds - kSpeeds / 2) * kSpacing * s.velocity_sigma;
            vy_[v] = (v / kSpeeds - kSpeeds / 2) * kSpacing * s.velocity_sigma;
            prior_[v] = std::exp(-0.5 * (vx_[v] * vx_[v] + vy_[v] * vy_[v]) / (s.velocity_sigma * s.velocity_sigma));
            all += prior_[v];
        }
        for (double &p : prior_) p /= all;
        ratio_.resize(places());
        sum_.resize(places());
    }

    size_t places() const { return size_t(rows_) * columns_; }

    void begin(Belief &b) const {
        b.unseen.resize(kVelocities * places());
        for (size_t k = 0; k < b.unseen.size(); ++k) b.unseen[k] = s.initial_count * prior_[k / places()] / double(places());
    }

    // Unseen targets move, end, leave, and new ones come.
    void move(Belief &b, double dt) {
        const double survival = std::exp(-dt / s.lifetime);
        std::vector<double> plane(places());
        for (int v = 0; v < kVelocities; ++v) {
            double *unseen = b.unseen.data() + v * places();
            const double fresh = s.births_per_s * s.lifetime * (1 - survival) * prior_[v] / double(places());
            const double right = vx_[v] * dt / width_, up = vy_[v] * dt / width_;
            const double j0 = std::floor(right), i0 = std::floor(up), fj = right - j0, fi = up - i0;
            const double w[2][2] = {{(1 - fi) * (1 - fj), (1 - fi) * fj}, {fi * (1 - fj), fi * fj}};
            std::fill(plane.begin(), plane.end(), fresh);
            for (int di = 0; di < 2; ++di)
                for (int dj = 0; dj < 2; ++dj) {
                    const double share = survival * w[di][dj];
                    const double by_i = i0 + di, by_j = j0 + dj;
                    if (share == 0 || std::abs(by_i) >= rows_ || std::abs(by_j) >= columns_) continue;
                    const int bi = int(by_i), bj = int(by_j);
                    for (int i = std::max(0, bi); i < std::min(rows_, rows_ + bi); ++i)
                        for (int j = std::max(0, bj); j < std::min(columns_, columns_ + bj); ++j)
                            plane[size_t(i) * columns_ + j] += share * unseen[size_t(i - bi) * columns_ + j - bj];
                }
            std::copy(plane.begin(), plane.end(), unseen);
        }
    }

    // Single out what has grown, given the members as predicted; its particles have the weight
    // that they had before the scan.
    int apply(Belief &b, Evidence &evidence, Coverage &coverage) {
        evidence.background(b);
        weigh(b, evidence);
        for (size_t c = 0; c < places(); ++c) sum_[c] *= ratio_[c];
        int born = 0;
        for (; born < s.births_per_step; ++born) {
            Newborn o;
            if (!propose(b, o)) break;
            settle(b, coverage, o);
        }
        return born;
    }

    // What the scan says of those that remain unseen, given all members after it.
    void update(Belief &b, Evidence &evidence) {
        weigh(b, evidence);
        for (int v = 0; v < kVelocities; ++v)
            for (size_t c = 0; c < places(); ++c) b.unseen[v * places() + c] *= ratio_[c];
    }

   private:
    const Settings &s;
    const CoverageMap &map_;
    int rows_, columns_;
    double width_;
    double vx_[kVelocities], vy_[kVelocities], prior_[kVelocities];
    std::vector<double> ratio_, sum_;

    double x_of(size_t c) const { return map_.x_min + (double(c % columns_) + 0.5) * width_; }
    double y_of(size_t c) const { return map_.y_min + (double(c / columns_) + 0.5) * width_; }

    void weigh(const Belief &b, Evidence &evidence) {
        std::fill(sum_.begin(), sum_.end(), 0.0);
        for (int v = 0; v < kVelocities; ++v)
            for (size_t c = 0; c < places(); ++c) sum_[c] += b.unseen[v * places() + c];
        const int half = s.birth_stride / 2;
        for (int i = 0; i < rows_; ++i)
            for (int j = 0; j < columns_; ++j) {
                const int row = std::min(i * s.birth_stride + half, map_.rows - 1);
                const int column = std::min(j * s.birth_stride + half, map_.columns - 1);
                ratio_[size_t(i) * columns_ + j] = evidence.ratio(row * map_.columns + column);
            }
    }

    // Draw a newborn about the place where most is, and take it out of the density.
    bool propose(Belief &b, Newborn &o) {
        const size_t best = std::max_element(sum_.begin(), sum_.end()) - sum_.begin();
        o.x = x_of(best), o.y = y_of(best);
        std::vector<size_t> near;
        std::vector<double> w;
        for (size_t c = 0; c < places(); ++c) {
            const double dx = x_of(c) - o.x, dy = y_of(c) - o.y;
            if (dx * dx + dy * dy > s.birth_radius * s.birth_radius || !(sum_[c] > 0)) continue;
            near.push_back(c);
            w.push_back(sum_[c]);
        }
        o.told = total(w);
        if (!(o.told >= s.least_birth)) return false;
        draw(b, near, w, o);
        for (size_t c : near) {
            sum_[c] = 0;
            for (int v = 0; v < kVelocities; ++v) b.unseen[v * places() + c] = 0;
        }
        return true;
    }

    void draw(Belief &b, const std::vector<size_t> &near, const std::vector<double> &w, Newborn &o) const {
        const int n = s.particles;
        Chance &chance = b.chance;
        const std::vector<int> index = systematic(w, n, chance.uniform(0));
        chance.spend(1);
        o.cloud.resize(n);
        o.weight.resize(n);
        const double spread = kSpacing * s.velocity_sigma, inside = 1 - 1e-9;
        const double x_max = map_.x_min + map_.columns * map_.cell * inside;
        const double y_max = map_.y_min + map_.rows * map_.cell * inside;
        for (int j = 0; j < n; ++j) {
            const uint64_t at = 5 * uint64_t(j);
            const size_t c = near[index[j]];
            double rest = chance.uniform(at) * w[index[j]] / ratio_[c];
            int v = 0;
            while (v + 1 < kVelocities && rest >= b.unseen[v * places() + c]) rest -= b.unseen[v++ * places() + c];
            o.cloud.x[j] = std::clamp(x_of(c) + width_ * (chance.uniform(at + 1) - 0.5), map_.x_min, x_max);
            o.cloud.y[j] = std::clamp(y_of(c) + width_ * (chance.uniform(at + 2) - 0.5), map_.y_min, y_max);
            o.cloud.vx[j] = vx_[v] + spread * (chance.uniform(at + 3) - 0.5);
            o.cloud.vy[j] = vy_[v] + spread * (chance.uniform(at + 4) - 0.5);
            o.weight[j] = o.told / ratio_[c] / n;
        }
        chance.spend(5 * uint64_t(n));
    }

    // One that has begun near by takes the newborn in: one target, not known when it came.
    void settle(Belief &b, Coverage &coverage, Newborn &o) const {
        Group *home = nullptr;
        size_t host = 0;
        double nearest = s.birth_reach * s.birth_reach;
        int members = 0;
        for (Group &g : b.groups)
            for (size_t m = 0; m < g.members.size(); ++m) {
                ++members;
                const Member &a = g.members[m];
                if (a.existence >= s.mature || a.confirmed) continue;
                const double dx = a.mean[0] - o.x, dy = a.mean[1] - o.y, d2 = dx * dx + dy * dy;
                if (d2 < nearest) nearest = d2, home = &g, host = m;
            }
        if (home) {
            mix(b.chance, *home, home->members[host], o);
            for (Member &m : home->members) coverage.update(*home, m);
            return;
        }
        if (members >= s.most_members) return;
        Group g;
        Member m;
        m.track = b.next_track++;
        m.first = b.t;
        m.existence = total(o.weight) / (1 + total(o.weight));
        m.cloud = std::move(o.cloud);
        m.mean[0] = o.x, m.mean[1] = o.y;
        g.weight = std::move(o.weight);
        normalize(g.weight);
        g.members.push_back(std::move(m));
        coverage.update(g, g.members[0]);
        b.groups.push_back(std::move(g));
    }

    // Beside the particles: a share of them become the newborn's. In a group: a share of those
    // without the host get the newborn. Weighed so that the sum is the sum of both densities.
    void mix(Chance &chance, Group &g, Member &m, const Newborn &o) const {
        const size_t n = g.weight.size();
        const double there = m.existence, share = std::clamp(o.told / (o.told + there), 0.05, 0.5);
        for (size_t j = 0; j < n; ++j) {
            if (g.joint() && m.cloud.here[j]) continue;
            if (chance.uniform(j) >= share) {
                g.weight[j] /= 1 - share;
                continue;
            }
            m.cloud.set(j, o.cloud, j);
            const double mass = g.joint() ? g.weight[j] * double(n) : 1 / there;
            g.weight[j] = mass * o.weight[j] / share;
        }
        chance.spend(n);
        const double odds = total(o.weight);
        if (!g.joint()) m.existence = (there + odds) / (1 + odds);
        normalize(g.weight);
        if (g.joint()) count_existence(g);
    }
};

}  // namespace trackfield::detect
