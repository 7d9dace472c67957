// What a scan says: the likelihood of every sensor's word, and what it tells of the sensors.
//
// P(silent | targets) = prod_t (1 - c_t p) - q prod_t (1 - c_t): a target t covers the sensor with
// probability c_t; covered by n >= 1 it is silent with (1 - p)^n, by none with 1 - q. The likelihood
// of its word is said + quiet * P(silent), because a node may be dead or stuck and a message lost.
#pragma once

#include "detect_particles.hpp"

namespace trackfield::detect {

class Evidence {
   public:
    Evidence(const Settings &settings, const CoverageMap &map, const std::vector<Sensor> &sensors)
        : s(settings), map_(map), sensors_(sensors), p_(sensors.size()), q_(p_), said_(p_), quiet_(p_), missed_(p_),
          bare_(p_), scale_(p_), joint_missed_(p_), joint_bare_(p_), mark_(sensors.size(), -1),
          cut_off_(p_), ratio_(map.cells()), round_of_(map.cells(), -1) {
        for (const Sensor &o : sensors) groups_ = std::max(groups_, o.group + 1);
    }

    void listen(const Belief &b, const int8_t *value) {
        const double more = b.p.factor(s.rate_weight), louder = b.q.factor(s.rate_weight);
        for (size_t i = 0; i < sensors_.size(); ++i) {
            p_[i] = std::min(0.999, sensors_[i].p * more);
            q_[i] = std::min(0.999 * p_[i], sensors_[i].q * louder);
            const double stuck = b.nodes[i].stuck, good = 1 - b.nodes[i].dead - stuck, d = sensors_[i].delivery;
            if (value[i] == 1) said_[i] = good + stuck, quiet_[i] = -good;
            else if (value[i] == 0) said_[i] = 0, quiet_[i] = 1;
            else if (s.says_zero) said_[i] = 1, quiet_[i] = 0;
            else said_[i] = 1 - d * (good + stuck), quiet_[i] = d * good;
        }
    }

    // What no target explains: more detections away from all members than `most_new` targets that
    // have just come would make are noise of this scan, and false alarms are that much likelier.
    // A group of which no word comes, though some was due, is cut off: what it does not say tells
    // nothing. `background` holds all members as predicted.
    void doubt(const Belief &b, const int8_t *value) {
        double hits = 0, expected = 0, seen = 0;
        for (size_t i = 0; i < sensors_.size(); ++i) {
            if (bare_[i] < 0.95) continue;
            hits += value[i] == 1;
            expected += q_[i] * sensors_[i].delivery;
        }
        for (const Seen &e : map_.seen) seen += e.covered;
        const double more = hits - s.most_new * seen / map_.cells();
        if (expected > 0 && more > expected)
            for (size_t i = 0; i < q_.size(); ++i) q_[i] = std::min(0.999 * p_[i], q_[i] * more / expected);
        std::vector<double> silence_of(groups_, 0.0);
        for (size_t i = 0; i < sensors_.size(); ++i) {
            const int g = sensors_[i].group;
            if (value[i] != -1) silence_of[g] = 1;
            if (silence_of[g] > 0) continue;
            const double good = 1 - b.nodes[i].dead - b.nodes[i].stuck;
            const double said = s.says_zero ? 1 : 1 - silence(i);
            silence_of[g] += std::log(1 - std::min(0.999, sensors_[i].delivery * good * said));
        }
        for (size_t i = 0; i < sensors_.size(); ++i) {
            const double log_silence = silence_of[sensors_[i].group];
            cut_off_[i] = log_silence > 0 ? 0 : s.outage / (s.outage + (1 - s.outage) * std::exp(log_silence));
            said_[i] += cut_off_[i] * (1 - said_[i]);
            quiet_[i] *= 1 - cut_off_[i];
        }
    }

    // Let all members stand behind the next likelihoods, but for one group.
    void background(const Belief &b, const Group *without = nullptr) {
        std::fill(missed_.begin(), missed_.end(), 1.0);
        std::fill(bare_.begin(), bare_.end(), 1.0);
        for (const Group &g : b.groups) {
            if (&g == without) continue;
            for (const Member &m : g.members)
                for (const Seen &e : m.cover) {
                    missed_[e.sensor] *= 1 - m.existence * e.covered * p_[e.sensor];
                    bare_[e.sensor] *= 1 - m.existence * e.covered;
                }
        }
        for (size_t i = 0; i < scale_.size(); ++i) scale_[i] = 1 / (said_[i] + quiet_[i] * silence(i));
        ++round_;
    }

    double silence(size_t i) const { return missed_[i] - q_[i] * bare_[i]; }
    double bare(size_t i) const { return bare_[i]; }

    // Likelihood with one more target in a cell over that without it.
    double ratio(int cell) {
        if (round_of_[cell] == round_) return ratio_[cell];
        double r = 1;
        for (const Seen *e = map_.begin(cell); e != map_.end(cell); ++e) {
            const int i = e->sensor;
            const double silent = missed_[i] * (1 - e->covered * p_[i]) - q_[i] * bare_[i] * (1 - e->covered);
            r *= (said_[i] + quiet_[i] * silent) * scale_[i];
        }
        round_of_[cell] = round_;
        return ratio_[cell] = std::pow(r, s.temper);
    }

    // The same with all members that exist in particle j, exactly.
    double ratio(const Group &g, size_t j) {
        touched_.clear();
        ++turn_;
        for (const Member &m : g.members) {
            if (!m.cloud.here[j]) continue;
            const int cell = map_.at(m.cloud.x[j], m.cloud.y[j]);
            for (const Seen *e = map_.begin(cell); e != map_.end(cell); ++e) {
                const int i = e->sensor;
                if (mark_[i] != turn_) {
                    mark_[i] = turn_;
                    touched_.push_back(i);
                    joint_missed_[i] = missed_[i];
                    joint_bare_[i] = bare_[i];
                }
                joint_missed_[i] *= 1 - e->covered * p_[i];
                joint_bare_[i] *= 1 - e->covered;
            }
        }
        double r = 1;
        for (int i : touched_) r *= (said_[i] + quiet_[i] * (joint_missed_[i] - q_[i] * joint_bare_[i])) * scale_[i];
        return std::pow(r, s.temper);
    }

    // What is believed of nodes, p and q after the scan. `background` has all members behind it.
    void learn(Belief &b, const int8_t *value, double dt) const {
        const double back = 1 - std::exp(-dt / s.node_time);
        // What is expected has the factors in it that are known so far; tries are without.
        const double more = b.p.factor(s.rate_weight), louder = b.q.factor(s.rate_weight);
        Rate p, q;
        for (size_t i = 0; i < sensors_.size(); ++i) {
            if (cut_off_[i] > 0.5) continue;
            Node &n = b.nodes[i];
            const double d = sensors_[i].delivery, one = 1 - silence(i), good = 1 - n.dead - n.stuck;
            if (!s.says_zero || value[i] >= 0) {
                const double expected = good * one * (s.says_zero ? 1 : d);
                if (bare_[i] > 0.95) q.hits += value[i] == 1, q.tries += expected / louder;
                else if (bare_[i] < 0.05) p.hits += value[i] == 1, p.tries += expected / more;
            }
            double if_good = 1 - d * one, if_dead = 1, if_stuck = 1 - d;  // silent
            if (value[i] == 1) if_good = d * one, if_dead = 0, if_stuck = d;
            else if (value[i] == 0) if_good = 1, if_dead = 0, if_stuck = 0;
            else if (s.says_zero) if_good = 1 - d;
            const double all = good * if_good + n.dead * if_dead + n.stuck * if_stuck;
            if (all > 0) n.dead *= if_dead / all, n.stuck *= if_stuck / all;
            n.dead += back * (s.dead - n.dead);
            n.stuck += back * (s.stuck - n.stuck);
        }
        fade(b.p, p);
        fade(b.q, q);
    }

    // What each sensor's word says for a member, over what it would say without it.
    void support(Belief &b, double dt) const {
        const double keep = std::exp(-dt / s.support_time);
        for (Group &g : b.groups)
            for (Member &m : g.members) {
                for (Support &o : m.support) o.log_ratio *= keep;
                m.log_ratio = 0;
                for (const Seen &e : m.cover) {
                    const double news = word(e.sensor, m.existence, e.covered);
                    m.log_ratio += news;
                    auto known = std::find_if(m.support.begin(), m.support.end(), [&](const Support &o) { return o.sensor == e.sensor; });
                    if (known != m.support.end()) known->log_ratio += news;
                    else m.support.push_back({e.sensor, news});
                }
                std::erase_if(m.support, [](const Support &o) { return std::abs(o.log_ratio) < 0.01; });
            }
    }

   private:
    const Settings &s;
    const CoverageMap &map_;
    const std::vector<Sensor> &sensors_;
    std::vector<double> p_, q_, said_, quiet_, missed_, bare_, scale_, joint_missed_, joint_bare_;
    std::vector<int64_t> mark_;
    std::vector<double> cut_off_;
    int groups_ = 1;
    std::vector<double> ratio_;
    std::vector<int64_t> round_of_;
    std::vector<int> touched_;
    int64_t round_ = 0, turn_ = 0;

    // `background` holds the member itself, which exists with `r`.
    double word(int i, double r, double covered) const {
        const double without_missed = missed_[i] / (1 - r * covered * p_[i]);
        const double hidden = 1 - r * covered;
        const double without_bare = hidden > 0 ? bare_[i] / hidden : 0;
        const double with = without_missed * (1 - covered * p_[i]) - q_[i] * without_bare * (1 - covered);
        const double without = without_missed - q_[i] * without_bare;
        return std::log((said_[i] + quiet_[i] * with) / (said_[i] + quiet_[i] * without));
    }

    void fade(Rate &old, const Rate &news) const {
        const double keep = std::exp(-news.tries / s.rate_memory);
        old.hits = keep * old.hits + news.hits;
        old.tries = keep * old.tries + news.tries;
    }
};

}  // namespace trackfield::detect
