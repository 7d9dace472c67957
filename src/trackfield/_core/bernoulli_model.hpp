// What the Bernoulli mixture is told before the first scan: targets, reports, limits of the work.
#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

namespace trackfield {

constexpr int kMaxRecent = 8;

struct Rect {
    double x_min = 0, y_min = 0, x_max = 1, y_max = 1;
    double area() const { return (x_max - x_min) * (y_max - y_min); }
};

// A quantity over a rectangle, constant within a cell; outside the nearest cell holds.
struct Map {
    Rect region;
    int rows = 1, columns = 1;
    std::vector<double> values{1.0};

    bool uniform() const { return values.size() == 1; }
    size_t cell(double x, double y) const {
        const double i = std::floor((y - region.y_min) / (region.y_max - region.y_min) * rows);
        const double j = std::floor((x - region.x_min) / (region.x_max - region.x_min) * columns);
        const int row = i < 0 ? 0 : i >= rows ? rows - 1 : int(i);
        const int column = j < 0 ? 0 : j >= columns ? columns - 1 : int(j);
        return size_t(row) * columns + column;
    }
    double at(double x, double y) const { return uniform() ? values[0] : values[cell(x, y)]; }
};

struct BernoulliModel {
    // Targets.
    double accel_sigma = 0, velocity_sigma = 1;
    double survival = 1;          // of a step; with a hazard, that by age holds instead
    std::vector<double> hazard;
    double births = 0;            // per step, in the whole region; negative: learned
    double initial_count = 0;
    Map birth_map, survival_map;  // relative
    // Reports.
    Rect region;
    double step = 1;
    double sigma = 0;             // 0: learned
    std::vector<Map> p_detection; // by age; empty: learned
    double false_per_scan = -1;   // negative: learned
    Map false_map;                // relative
    // What is learned starts here, with the weight of so many reports, scans or births.
    double first_sigma = 1, first_p_detection = 0.75, first_false = 5, first_births = 0.1;
    double weight_sigma = 10, weight_p_detection = 10, weight_false = 2, weight_births = 2;
    double memory_sigma = 200, memory_p_detection = 200, memory_false = 50, memory_births = 200;
    // The mixture.
    double gate = 20;             // largest squared Mahalanobis distance of a report
    double least_existence = 1e-3, least_weight = 1e-4;
    double joined_existence = 0.02; // a target less likely than this is taken as independent of others
    double dependence = 0.005;      // total variation above which two targets stay in one cluster
    double duplicates = 0.1;        // share of the time in which two names may both be there and still be one
    int recent = 5;               // scans whose reports keep hypotheses apart
    int hypotheses = 100;         // of a cluster
    double poor = 0.3;            // share of the mean weight above which the last hypothesis kept tells of many lost
    int leaves = 10;              // of a target in a cluster too large for enumeration
    int max_tracks = 1000;
    int64_t work = 100000;        // nodes of all enumerations in a step
    int64_t cluster_work = 20000; // nodes of one
    int history = 10;             // scans kept for hindsight
    double cutoff = 5;            // c: an error beyond this is as bad as a miss and a false track [m]
    double near = 2;              // components this far from the likeliest are not averaged with it [m]
};

}  // namespace trackfield
