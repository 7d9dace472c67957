// Tracks that may have met the same reports, decided on together: exactly, or by belief propagation.
#pragma once

#include "bernoulli_draft.hpp"
#include "bernoulli_enumerate.hpp"
#include "bernoulli_propagation.hpp"

namespace trackfield {

// One scan as the components see it.
struct ScanView {
    const BernoulliModel &model;
    const Frame &before;
    const std::vector<Leaf> &leaves;  // predicted
    const std::vector<BernoulliReport> &reports;
    const Options &options;
};

struct Resolved {
    std::vector<Draft> drafts;
    std::vector<double> unassigned;  // of each report of the component: P(no known target gave it)
    int64_t work = 0;
    bool propagated = false;
};

// The history after an option: what was met, and the existence that follows from it.
inline Leaf grown(const ScanView &scan, int32_t leaf, int32_t option) {
    Leaf next = scan.leaves[leaf];
    std::copy_backward(next.recent.begin(), next.recent.end() - 1, next.recent.end());
    const int32_t j = scan.options.options[option].report;
    if (j >= 0) {
        const BernoulliReport &z = scan.reports[j];
        next.state = next.state.updated(z.x, z.y, z.R);
        next.existence = 1;
        next.recent[0] = z.number;
    } else {
        const double p = scan.options.p_detection[leaf], r = next.existence;
        next.existence = r * (1 - p) / std::max(1 - r * p, 1e-300);
        next.recent[0] = -1;
    }
    return next;
}

// What a report starts that no known target gave.
inline DraftTrack newborn(const ScanView &scan, int32_t report, double t) {
    const BernoulliReport &z = scan.reports[report];
    Leaf leaf;
    leaf.state.x = z.x;
    leaf.state.y = z.y;
    leaf.state.A = z.R;
    leaf.state.C.xx = leaf.state.C.yy = scan.model.velocity_sigma * scan.model.velocity_sigma;
    leaf.existence = z.first;
    leaf.weight = 1;
    leaf.recent.fill(-1);
    leaf.recent[0] = z.number;
    return {z.number, t, {leaf}};
}

inline Draft alone(DraftTrack track) {
    Draft d;
    d.tracks.push_back(std::move(track));
    d.weight = {1};
    d.choice = {0};
    return d;
}

class Component {
  public:
    Component(const ScanView &scan, double t) : s_(scan), t_(t), local_(scan.reports.size(), -1) {}

    // `clusters` of the scan before that share `reports` of this one.
    Resolved resolve(const std::vector<int32_t> &clusters, const std::vector<int32_t> &reports, int64_t budget) {
        Resolved out;
        Joint joint;
        Enumeration exact(s_.options, s_.reports.size(), s_.model);
        const bool found = together(clusters, budget, joint, out.work) && exact.run(joint, budget - out.work);
        out.work += exact.work;
        if (found) {
            explain(joint, exact, reports, out);
        } else {
            out.propagated = true;
            propagate_all(clusters, reports, out);
        }
        return out;
    }

  private:
    const ScanView &s_;
    const double t_;
    std::vector<int32_t> local_;  // scratch: place of a report in the component

    // The product of the clusters' hypotheses, without its unlikely part; false if the budget did not suffice.
    bool together(const std::vector<int32_t> &clusters, int64_t budget, Joint &joint, int64_t &work) const {
        const size_t most = size_t(s_.model.hypotheses);
        joint.log_weight = {0};
        for (int32_t c : clusters) {
            const Cluster &cluster = s_.before.clusters[c];
            const size_t n = joint.tracks.size(), m = size_t(cluster.tracks());
            std::vector<double> log_new(cluster.weight.size());
            for (size_t g = 0; g < log_new.size(); ++g) log_new[g] = std::log(cluster.weight[g]);
            const double least = joint.log_weight[0] + log_new[0] + std::log(s_.model.least_weight);
            std::vector<std::pair<double, std::pair<int32_t, int32_t>>> pairs;
            for (size_t h = 0; h < joint.size(); ++h)
                // Both come likeliest first, so (h + 1) (g + 1) pairs are at least as likely as this one.
                for (size_t g = 0; g < log_new.size() && (h + 1) * (g + 1) <= most; ++g) {
                    const double w = joint.log_weight[h] + log_new[g];
                    if (w < least) break;
                    pairs.push_back({w, {int32_t(h), int32_t(g)}});
                }
            std::sort(pairs.begin(), pairs.end(), [](auto &a, auto &b) { return a.first != b.first ? a.first > b.first : a.second < b.second; });
            if (pairs.size() > most) pairs.resize(most);
            work += int64_t(pairs.size() * (1 + (n + m) / 32));
            if (work > budget) return false;
            Joint next;
            next.tracks = joint.tracks;
            for (int32_t i = cluster.begin; i < cluster.end; ++i) next.tracks.push_back(i);
            next.leaf.reserve(pairs.size() * (n + m));
            for (auto &[w, hg] : pairs) {
                next.log_weight.push_back(w);
                const int32_t *a = joint.row(size_t(hg.first)), *b = cluster.leaf.data() + size_t(hg.second) * m;
                next.leaf.insert(next.leaf.end(), a, a + n);
                next.leaf.insert(next.leaf.end(), b, b + m);
            }
            joint = std::move(next);
        }
        return true;
    }

    void explain(const Joint &joint, const Enumeration &exact, const std::vector<int32_t> &reports, Resolved &out) {
        const size_t n = joint.tracks.size(), H = exact.found.size(), m = reports.size();
        for (size_t j = 0; j < m; ++j) local_[reports[j]] = int32_t(j);
        std::vector<double> weight(H);
        double total = 0;
        for (size_t h = 0; h < H; ++h) total += weight[h] = std::exp(exact.found[h].log_weight - exact.found[0].log_weight);
        for (double &w : weight) w /= total;
        std::vector<char> taken(H * m, 0);
        out.unassigned.assign(m, 0.0);
        for (size_t h = 0; h < H; ++h) {
            for (size_t i = 0; i < n; ++i) {
                const int32_t k = exact.options[exact.found[h].at + i];
                if (k >= 0 && s_.options.options[k].report >= 0) taken[h * m + local_[s_.options.options[k].report]] = 1;
            }
            for (size_t j = 0; j < m; ++j)
                if (!taken[h * m + j]) out.unassigned[j] += weight[h];
        }
        Draft d;
        std::vector<size_t> starts;  // reports whose new track is decided on together with the others
        for (size_t j = 0; j < m; ++j) {
            DraftTrack track = newborn(s_, reports[j], t_);
            const double r = out.unassigned[j] * track.leaves[0].existence;
            if (r < s_.model.least_existence) continue;
            if (r < s_.model.joined_existence || out.unassigned[j] > 1 - 1e-9) {
                track.leaves[0].existence = r;
                out.drafts.push_back(alone(std::move(track)));
            } else {
                starts.push_back(j);
            }
        }
        const size_t columns = n + starts.size();
        d.weight = std::move(weight);
        d.choice.assign(H * columns, -1);
        std::vector<int32_t> options_of;
        for (size_t i = 0; i < n; ++i) {
            const Track &old = s_.before.tracks[joint.tracks[i]];
            DraftTrack track{old.id, old.first, {}};
            options_of.clear();
            for (size_t h = 0; h < H; ++h) {
                const int32_t k = exact.options[exact.found[h].at + i];
                if (k < 0) continue;
                size_t place = size_t(std::find(options_of.begin(), options_of.end(), k) - options_of.begin());
                if (place == options_of.size()) {
                    options_of.push_back(k);
                    track.leaves.push_back(grown(s_, joint.row(size_t(exact.found[h].hypothesis))[i], k));
                }
                d.choice[h * columns + i] = int32_t(place);
            }
            d.tracks.push_back(std::move(track));
        }
        for (size_t k = 0; k < starts.size(); ++k) {
            d.tracks.push_back(newborn(s_, reports[starts[k]], t_));
            for (size_t h = 0; h < H; ++h)
                if (!taken[h * m + starts[k]]) d.choice[h * columns + n + k] = 0;
        }
        out.drafts.push_back(std::move(d));
    }

    // Each track by itself, its histories weighed by the marginals of who gave which report.
    void propagate_all(const std::vector<int32_t> &clusters, const std::vector<int32_t> &reports, Resolved &out) {
        for (size_t j = 0; j < reports.size(); ++j) local_[reports[j]] = int32_t(j);
        std::vector<Link> links;
        std::vector<int32_t> tracks;
        std::vector<double> missed;  // sum of p_l (1 - r_l p) over a track's leaves, the absent one included
        for (int32_t c : clusters)
            for (int32_t i = s_.before.clusters[c].begin; i < s_.before.clusters[c].end; ++i) {
                const Track &track = s_.before.tracks[i];
                const size_t first = links.size();
                double present = 0, miss = 0;
                for (int32_t l = track.begin; l < track.end; ++l) {
                    const double w = s_.leaves[l].weight;
                    present += w;
                    for (int32_t k = s_.options.begin[l]; k < s_.options.begin[l + 1]; ++k) {
                        const Option &option = s_.options.options[k];
                        const double v = w * std::exp(option.log_weight);
                        if (option.report < 0) {
                            miss += v;
                            continue;
                        }
                        const int32_t j = local_[option.report];
                        size_t e = first;
                        while (e < links.size() && links[e].report != j) ++e;
                        if (e == links.size()) links.push_back({int32_t(tracks.size()), j, 0, 0});
                        links[e].weight += v;
                    }
                }
                miss += std::max(0.0, 1 - present);
                miss = std::max(miss, 1e-12);
                for (size_t e = first; e < links.size(); ++e) links[e].weight = std::min(links[e].weight / miss, 1e12);
                tracks.push_back(i);
                missed.push_back(miss);
            }
        out.work += propagate(links, tracks.size(), reports.size(), s_.model.work);
        out.unassigned.assign(reports.size(), 1.0);
        size_t e = 0;
        for (size_t i = 0; i < tracks.size(); ++i) {
            const size_t first = e;
            double free = 1;
            for (; e < links.size() && links[e].track == int32_t(i); ++e) {
                out.unassigned[links[e].report] -= links[e].marginal;
                free -= links[e].marginal;
            }
            separate(tracks[i], links, first, e, std::max(free, 0.0) / missed[i], missed[i], out);
        }
        for (size_t j = 0; j < reports.size(); ++j) {
            out.unassigned[j] = std::clamp(out.unassigned[j], 0.0, 1.0);
            DraftTrack track = newborn(s_, reports[j], t_);
            track.leaves[0].existence *= out.unassigned[j];
            if (track.leaves[0].existence >= s_.model.least_existence) out.drafts.push_back(alone(std::move(track)));
        }
    }

    void separate(int32_t track, const std::vector<Link> &links, size_t begin, size_t end, double scale_missed, double missed, Resolved &out) {
        const Track &old = s_.before.tracks[track];
        DraftTrack grown_track{old.id, old.first, {}};
        double all = 0;
        for (int32_t l = old.begin; l < old.end; ++l)
            for (int32_t k = s_.options.begin[l]; k < s_.options.begin[l + 1]; ++k) {
                const Option &option = s_.options.options[k];
                double w = s_.leaves[l].weight * std::exp(option.log_weight);
                if (option.report < 0) {
                    w *= scale_missed;
                } else {
                    size_t e = begin;
                    while (e < end && links[e].report != local_[option.report]) ++e;
                    w *= links[e].marginal / (links[e].weight * missed);
                }
                all += w;
                if (w < s_.model.least_weight) continue;
                grown_track.leaves.push_back(grown(s_, l, k));
                grown_track.leaves.back().weight = w;
            }
        if (grown_track.leaves.empty()) return;
        Draft d;
        d.tracks.push_back(std::move(grown_track));
        std::vector<Leaf> &leaves = d.tracks[0].leaves;
        std::sort(leaves.begin(), leaves.end(), [](const Leaf &a, const Leaf &b) { return a.weight > b.weight; });
        if (leaves.size() > size_t(s_.model.leaves)) leaves.resize(size_t(s_.model.leaves));
        double kept = 0;
        for (const Leaf &leaf : leaves) kept += leaf.weight;
        for (size_t k = 0; k < leaves.size(); ++k) {
            d.weight.push_back(leaves[k].weight * all / kept);  // what is left out must not make the target unlikely
            d.choice.push_back(int32_t(k));
        }
        if (all < 1 - s_.model.least_weight) {
            d.weight.push_back(1 - all);
            d.choice.push_back(-1);
        }
        out.drafts.push_back(std::move(d));
    }
};

}  // namespace trackfield
