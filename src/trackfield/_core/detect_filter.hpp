// One step of the filter: who moves, who appears, who is joint with whom, what the scan says of it.
#pragma once

#include "detect_archive.hpp"
#include "detect_births.hpp"
#include "detect_groups.hpp"
#include "detect_hindsight.hpp"

namespace trackfield::detect {

struct Work {
    int births = 0, largest = 0, members = 0;
    double particles = 0;
};

class Filter {
   public:
    Filter(const Settings &settings, CoverageMap map, std::vector<Sensor> sensors)
        : s(settings), map_(std::move(map)), sensors_(std::move(sensors)), coverage_(map_, sensors_.size()),
          evidence_(s, map_, sensors_), grouping_(s, sensors_.size()), births_(s, map_) {}
    Filter(const Filter &) = delete;

    Belief initial(uint64_t seed) const {
        Belief b;
        b.chance.key = scrambled(seed + 0x9e3779b97f4a7c15ULL);
        b.nodes.assign(sensors_.size(), Node{s.dead, s.stuck});
        births_.begin(b);
        return b;
    }

    Work step(Belief &b, double t, double dt, const int8_t *value) {
        Work work;
        b.t = t;
        evidence_.listen(b, value);
        for (Group &g : b.groups) {
            for (Member &m : g.members) remember(m.cloud, s.history);
            move(b.chance, g, dt);
        }
        drop(b);
        evidence_.background(b);
        evidence_.doubt(b, value);
        births_.move(b, dt);
        work.births = births_.apply(b, evidence_, coverage_);
        grouping_.apply(b);
        // The surest first: what they explain starts nothing.
        std::stable_sort(b.groups.begin(), b.groups.end(), [](const Group &x, const Group &y) { return surest(x) > surest(y); });
        for (Group &g : b.groups) {
            evidence_.background(b, &g);
            g.joint() ? update_joint(b.chance, g) : update_alone(b.chance, g);
            for (Member &m : g.members) coverage_.update(g, m);
            work.largest = std::max(work.largest, int(g.members.size()));
            work.members += int(g.members.size());
        }
        drop(b);
        evidence_.background(b);
        births_.update(b, evidence_);
        evidence_.learn(b, value, dt);
        evidence_.support(b, dt);
        for (Group &g : b.groups) {
            summarize(g);
            for (Member &m : g.members) {
                m.confirmed = m.confirmed || m.existence > s.confirm;
                record(m, t, s.history);
            }
        }
        forget(b, s.history);
        return work;
    }

    const Settings s;
    size_t sensors() const { return sensors_.size(); }
    bool fits(const Belief &b) const { return sound(b, map_, sensors_.size(), kVelocities * births_.places()); }

   private:
    const CoverageMap map_;
    const std::vector<Sensor> sensors_;
    Coverage coverage_;
    Evidence evidence_;
    Grouping grouping_;
    Births births_;

    static double surest(const Group &g) {
        double r = 0;
        for (const Member &m : g.members) r = std::max(r, m.existence);
        return std::round(r * 1e6);  // two that are sure keep their order, whatever the last bits say
    }

    // x' = x + dt (v + u/2), v' = v + u: white acceleration, and now and then a new velocity.
    void move(Chance &chance, Group &g, double dt) {
        const size_t n = g.weight.size();
        const double sigma = std::sqrt(s.accel_density * dt), turns = 1 - std::exp(-dt * s.turn_rate);
        const double survival = std::exp(-dt / s.lifetime);
        for (Member &m : g.members) {
            m.mean[0] += dt * m.mean[2], m.mean[1] += dt * m.mean[3];
            Cloud &c = m.cloud;
            for (size_t j = 0; j < n; ++j) {
                const double scale = chance.uniform(4 * j) < turns ? s.turn_sigma : sigma;
                const double ux = scale * chance.normal(4 * j + 1), uy = scale * chance.normal(4 * j + 2);
                c.x[j] += dt * (c.vx[j] + 0.5 * ux);
                c.y[j] += dt * (c.vy[j] + 0.5 * uy);
                c.vx[j] += ux;
                c.vy[j] += uy;
                c.here[j] = c.here[j] && map_.at(c.x[j], c.y[j]) >= 0;
                if (g.joint()) c.here[j] = c.here[j] && chance.uniform(4 * j + 3) < survival;
            }
            chance.spend(4 * n);
        }
        if (g.joint()) {
            for (Member &m : g.members) {
                const double before = m.existence;
                m.existence = existence(g, m);
                if (!m.records.empty() && before > 0) m.records.back().survival = m.existence / before;
            }
        } else {
            Member &m = g.members[0];
            const double stays = survival * existence(g, m);
            if (!m.records.empty()) m.records.back().survival = stays;
            m.existence *= stays;
            if (m.existence >= s.drop) retain(chance, g);
        }
        for (Member &m : g.members)
            if (m.existence >= s.drop) coverage_.update(g, m);
    }

    // A member alone exists in all its particles.
    static void retain(Chance &chance, Group &g) {
        Member &m = g.members[0];
        if (std::find(m.cloud.here.begin(), m.cloud.here.end(), 0) == m.cloud.here.end()) return;
        m.cloud = marginal(chance, g, m);
        g.weight.assign(g.weight.size(), 1.0 / double(g.weight.size()));
    }

    void update_alone(Chance &chance, Group &g) {
        Member &m = g.members[0];
        Cloud &c = m.cloud;
        for (size_t j = 0; j < c.size(); ++j) g.weight[j] *= evidence_.ratio(map_.at(c.x[j], c.y[j]));
        const double mean = total(g.weight), r = m.existence;
        m.existence = r * mean / (1 - r + r * mean);
        if (!(mean > 0)) return;
        gather(c, systematic(g.weight, int(c.size()), chance.uniform(0)));
        chance.spend(1);
        g.weight.assign(c.size(), 1.0 / double(c.size()));
    }

    // Resampled in two strata, with and without the least sure member, so that one that has begun
    // keeps enough particles however unlikely it still is.
    void update_joint(Chance &chance, Group &g) {
        for (size_t j = 0; j < g.weight.size(); ++j) g.weight[j] *= evidence_.ratio(g, j);
        normalize(g.weight);
        count_existence(g);
        const Member *least = &g.members[0];
        for (const Member &m : g.members)
            if (m.existence < least->existence) least = &m;
        const int n = int(g.weight.size());
        std::vector<double> with(n), without(n);
        for (int j = 0; j < n; ++j) (least->cloud.here[j] ? with : without)[j] = g.weight[j];
        const double r = total(with), not_r = total(without);
        const int k = !(r > 0) ? 0 : !(not_r > 0) ? n : std::min(n - 1, int(std::lround(n * std::max(r, 0.5))));
        std::vector<int> index;
        if (k > 0) index = systematic(with, k, chance.uniform(0));
        if (k < n) {
            const std::vector<int> rest = systematic(without, n - k, chance.uniform(1));
            index.insert(index.end(), rest.begin(), rest.end());
        }
        chance.spend(2);
        for (Member &m : g.members) gather(m.cloud, index);
        for (int j = 0; j < n; ++j) g.weight[j] = j < k ? r / k : not_r / (n - k);
        normalize(g.weight);
        count_existence(g);
    }

    void drop(Belief &b) {
        for (Group &g : b.groups) {
            const bool was_joint = g.joint();
            for (Member &m : g.members)
                if (!(m.existence >= s.drop) && m.confirmed) end(b, m);
            std::erase_if(g.members, [&](const Member &m) { return !(m.existence >= s.drop); });
            if (!was_joint || g.members.size() != 1) continue;
            Member &m = g.members[0];
            m.cloud = marginal(b.chance, g, m);
            g.weight.assign(g.weight.size(), 1.0 / double(g.weight.size()));
        }
        std::erase_if(b.groups, [](const Group &g) { return g.members.empty(); });
    }

    void summarize(Group &g) const {
        Names names;
        if (g.joint()) names = names_of(g, s.mature, s.name_horizon);
        for (size_t m = 0, a = 0; m < g.members.size(); ++m) {
            const bool is_named = a < names.members.size() && names.members[a] == int(m);
            moments(g.weight, is_named ? named(g, names, int(a)) : g.members[m].cloud, g.members[m]);
            a += is_named;
        }
    }
};

}  // namespace trackfield::detect
