// Marginal probabilities of who gave which report, by loopy belief propagation, Williams and Lau (2014).
#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

namespace trackfield {

// One possible pair: `weight` of the report for the track over that of a miss.
struct Link {
    int32_t track = 0, report = 0;
    double weight = 0;
    double marginal = 0;  // found
};

// Fills the marginals; links come track by track. Returns the work done.
inline int64_t propagate(std::vector<Link> &links, size_t tracks, size_t reports, int64_t work_limit) {
    const size_t E = links.size();
    std::vector<double> to_report(E, 0.0), to_track(E, 1.0), sum_track(tracks), sum_report(reports);
    const int64_t rounds = std::clamp<int64_t>(work_limit / int64_t(E + 1), 5, 200);
    int64_t round = 0;
    for (; round < rounds; ++round) {
        std::fill(sum_track.begin(), sum_track.end(), 1.0);
        for (size_t e = 0; e < E; ++e) sum_track[links[e].track] += links[e].weight * to_track[e];
        std::fill(sum_report.begin(), sum_report.end(), 1.0);
        for (size_t e = 0; e < E; ++e) {
            const double w = links[e].weight;
            to_report[e] = w / std::max(sum_track[links[e].track] - w * to_track[e], 1.0);
            sum_report[links[e].report] += to_report[e];
        }
        double change = 0;
        for (size_t e = 0; e < E; ++e) {
            const double next = 1 / std::max(sum_report[links[e].report] - to_report[e], 1.0);
            change = std::max(change, std::abs(next - to_track[e]));
            to_track[e] = next;
        }
        if (change < 1e-5) break;
    }
    std::fill(sum_track.begin(), sum_track.end(), 1.0);
    for (size_t e = 0; e < E; ++e) sum_track[links[e].track] += links[e].weight * to_track[e];
    for (size_t e = 0; e < E; ++e) links[e].marginal = links[e].weight * to_track[e] / sum_track[links[e].track];
    return (round + 1) * int64_t(E);
}

}  // namespace trackfield
