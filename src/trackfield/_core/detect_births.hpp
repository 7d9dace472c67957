// Targets that appear: proposed where the scan asks for one more, with the prior's weight.
#pragma once

#include "detect_evidence.hpp"

namespace trackfield::detect {

struct Newborn {
    Cloud cloud;
    std::vector<double> weight;  // prior over proposal, mean such that sum = prior odds
    double odds = 0;             // that it is there before the scan
    double told = 0;             // and after it, seen alone
    double x = 0, y = 0;
};

class Births {
   public:
    Births(const Settings &settings, const CoverageMap &map) : s(settings), map_(map) {
        const int stride = s.birth_stride;
        for (int i = stride / 2; i < map_.rows; i += stride)
            for (int j = stride / 2; j < map_.columns; j += stride) places_.push_back(i * map_.columns + j);
    }

    int apply(Belief &b, Evidence &evidence, Coverage &coverage, double dt) {
        evidence.background(b);
        ratio_.clear();
        for (int cell : places_) ratio_.push_back(evidence.ratio(cell));
        const double each = s.births_per_s * dt / double(places_.size());
        std::vector<Newborn> found;
        for (int k = 0; k < s.births_per_step; ++k)
            if (!propose(b.chance, each, found)) break;
        for (Newborn &o : found) settle(b, coverage, o);
        return int(found.size());
    }

   private:
    const Settings &s;
    const CoverageMap &map_;
    std::vector<int> places_;
    std::vector<double> ratio_;

    // Draw a newborn about the place that the scan asks for most, and take the place off the map.
    bool propose(Chance &chance, double each, std::vector<Newborn> &found) {
        const size_t best = std::max_element(ratio_.begin(), ratio_.end()) - ratio_.begin();
        if (!(ratio_[best] > 1)) return false;
        Newborn o;
        o.x = map_.x_of(places_[best]), o.y = map_.y_of(places_[best]);
        std::vector<int> near;
        std::vector<double> w;
        for (size_t l = 0; l < places_.size(); ++l) {
            const double dx = map_.x_of(places_[l]) - o.x, dy = map_.y_of(places_[l]) - o.y;
            if (dx * dx + dy * dy > s.birth_radius * s.birth_radius || !(ratio_[l] > 0)) continue;
            near.push_back(places_[l]);
            w.push_back(ratio_[l]);
            ratio_[l] = 0;
        }
        const double sum = total(w);
        o.odds = each * double(near.size());
        o.told = each * sum;
        if (o.told < s.least_birth) return false;
        const int n = s.particles;
        const std::vector<int> index = systematic(w, n, chance.uniform(0));
        chance.spend(1);
        o.cloud.resize(n);
        o.weight.resize(n);
        const double width = s.birth_stride * map_.cell, inside = 1 - 1e-9;
        for (int j = 0; j < n; ++j) {
            const int cell = near[index[j]];
            const double x = map_.x_of(cell) + width * (chance.uniform(4 * j) - 0.5);
            const double y = map_.y_of(cell) + width * (chance.uniform(4 * j + 1) - 0.5);
            o.cloud.x[j] = std::clamp(x, map_.x_min, map_.x_min + map_.columns * map_.cell * inside);
            o.cloud.y[j] = std::clamp(y, map_.y_min, map_.y_min + map_.rows * map_.cell * inside);
            o.cloud.vx[j] = s.velocity_sigma * chance.normal(4 * j + 2);
            o.cloud.vy[j] = s.velocity_sigma * chance.normal(4 * j + 3);
            o.weight[j] = o.told / w[index[j]] / n;
        }
        chance.spend(4 * n);
        found.push_back(std::move(o));
        return true;
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
