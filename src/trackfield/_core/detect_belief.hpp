// What is believed of a field: clouds of particles, groups, nodes. Values: a copy is a snapshot.
#pragma once

#include <cstdint>
#include <vector>

#include "detect_chance.hpp"
#include "detect_map.hpp"

namespace trackfield::detect {

// What is settled before the first reading; Python gives every number (association/detect.py).
struct Settings {
    int particles = 0;
    double accel_density = 0;           // white acceleration [m^2/s^3]
    double turn_rate = 0, turn_sigma = 0;  // sudden changes of velocity: how often [1/s], per axis [m/s]
    double velocity_sigma = 0;          // of a target that appears, per axis [m/s]
    double lifetime = 0;                // mean [s]
    double births_per_s = 0;            // in the whole region
    double initial_count = 0;           // expected number of targets when the run begins
    double temper = 1;                  // power of the likelihood of a scan
    double join = 0, part = 0;          // coverage shared by members that join a group, that leave it
    int group_size = 0;
    int most_members = 0;
    double drop = 0, confirm = 0, mature = 0;  // existence
    double birth_radius = 0, birth_reach = 0;            // [m]
    int birth_stride = 0, births_per_step = 0;
    double least_birth = 0;
    double name_horizon = 0;            // [s]
    double node_time = 0;               // in which a node may die or come back [s]
    double dead = 0, stuck = 0;         // share of nodes
    double most_new = 0;                // targets that may come in one step
    double outage = 0;                  // probability that a group is cut off in a step
    bool says_zero = false;             // a node without a detection sends a 0
    double rate_weight = 0, rate_memory = 0;  // of the learned p and q, in readings
    int history = 0;                    // steps that hindsight reaches back
    double support_time = 0;            // in which what a sensor said for a track fades [s]
};

struct Sensor {
    double p = 0, q = 0, delivery = 1;
    int group = 0;  // of the network: cut off together
};

struct Point {
    float x, y, vx, vy;
};

struct Cloud {
    std::vector<double> x, y, vx, vy;
    std::vector<uint8_t> here;              // whether the target exists in this particle
    std::vector<std::vector<Point>> past;   // where the particle came from, the last step first

    size_t size() const { return x.size(); }
    void resize(size_t n) {
        for (auto *axis : {&x, &y, &vx, &vy}) axis->resize(n);
        here.resize(n, 1);
    }
    // Particle j becomes particle k of another cloud; a past that the other lacks stands still.
    void set(size_t j, const Cloud &o, size_t k) {
        x[j] = o.x[k], y[j] = o.y[k], vx[j] = o.vx[k], vy[j] = o.vy[k], here[j] = o.here[k];
        const Point now{float(x[j]), float(y[j]), float(vx[j]), float(vy[j])};
        for (size_t l = 0; l < past.size(); ++l) past[l][j] = l < o.past.size() ? o.past[l][k] : now;
    }
};

// What was believed of a member after a step.
struct Record {
    double t = 0, existence = 0;
    double survival = 1;  // of the next step, region's border included
    double mean[4] = {};  // x, y, vx, vy given existence, and the upper triangle of the covariance
    double cov[10] = {};
};

struct Support {
    int32_t sensor;
    double log_ratio;  // of what it said, with the member over without, fading
};

struct Member {
    int32_t track = 0;
    double first = 0;
    double existence = 0;
    bool confirmed = false;
    Cloud cloud;
    std::vector<Seen> cover;       // the sensors, and how surely each covers the target if it exists
    double mean[4] = {};
    double cov[10] = {};
    std::vector<Record> records;   // of the steps before and this one, the oldest first
    std::vector<Support> support;
    double log_ratio = 0;          // of this scan alone, over all sensors
};

// Members with one particle index: particle j of all of them together is one joint hypothesis, in
// which `here` tells who exists. A member alone exists in all its particles: `existence` stands
// beside them, so that an unlikely target has as many particles as a sure one.
struct Group {
    std::vector<Member> members;
    std::vector<double> weight;  // sum 1
    bool joint() const { return members.size() > 1; }
};

struct Node {
    double dead = 0, stuck = 0;  // probabilities
};

struct Rate {
    double hits = 0, tries = 0;  // detections, and how many the model expected
    double factor(double weight) const { return (weight + hits) / (weight + tries); }
};

struct Belief {
    double t = 0;
    int32_t next_track = 1;
    Chance chance;
    std::vector<Node> nodes;
    Rate p, q;
    std::vector<double> unseen;  // expected targets not yet singled out, by velocity and place
    std::vector<Group> groups;
    std::vector<Member> ended;  // confirmed ones of the last steps, without particles, for hindsight
    std::vector<double> times;  // of the last scans, the newest last
};

}  // namespace trackfield::detect
