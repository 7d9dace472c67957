// All possible targets of one scan: histories (leaves), tracks, clusters of joint hypotheses.
#pragma once

#include <array>
#include <memory>

#include "bernoulli_gaussian.hpp"
#include "bernoulli_model.hpp"

namespace trackfield {

constexpr int kRings = 6;

using Recent = std::array<int32_t, kMaxRecent>;  // report numbers of the last scans, newest first; -1: none

// One history of a track: which report in which scan.
struct Leaf {
    Plane state;
    double existence = 0;  // given this history
    double weight = 0;     // of this history
    double survival = 1;   // from the scan before
    int32_t parent = -1;   // place among the leaves of the scan before
    Recent recent{};
    int32_t report() const { return recent[0]; }
};

struct Track {
    int32_t id = 0;              // the number of its first report: the same in every replay
    int32_t begin = 0, end = 0;  // its leaves
    double first = 0;            // time of its first report
};

// Tracks that are decided on together. A hypothesis names a leaf for each (-1: no such target).
struct Cluster {
    int32_t begin = 0, end = 0;  // its tracks
    std::vector<double> weight;
    std::vector<int32_t> leaf;   // (hypotheses, tracks)
    int32_t tracks() const { return end - begin; }
};

struct Frame {
    double t = 0;
    std::vector<Leaf> leaves;
    std::vector<Track> tracks;
    std::vector<Cluster> clusters;
};

// Running mean with prior and forgetting: sum over weight.
struct Learned {
    double sum = 0, weight = 0;
    double mean() const { return sum / weight; }
    void add(double s, double w, double memory) {
        const double keep = weight > memory ? memory / weight : 1;
        sum = sum * keep + s;
        weight = weight * keep + w;
    }
    // Towards where the mean would say of itself what was found: found/mean has mean 1 there. `pace` makes
    // up for the part of a wrong mean that its own use hides.
    void correct(double s, double w, double memory, double pace) {
        if (w <= 0) return;
        const double before = mean(), ratio = s / (w * before);
        weight = std::min(weight, memory) + w;
        sum = before * std::exp(pace * w / weight * std::clamp(ratio - 1, -1.0, 2.0)) * weight;
    }
};

struct StepCounts {
    int64_t enumerated = 0, propagated = 0, burst = 0, crowded_out = 0, work = 0;
};

// A value: a step makes a new one that shares the frames.
struct BernoulliState {
    std::vector<std::shared_ptr<const Frame>> frames;  // the newest last
    std::vector<double> undetected;  // expected number per area of targets never seen, a cell each
    Learned false_reports, p_detection, variance;
    Learned births;                  // a step
    double begun = 0;                // time of the first scan
    std::array<Learned, kRings> shadow;  // false reports near likely targets over those of an even spread
    StepCounts counts;  // of the newest step
};

}  // namespace trackfield
