// One scan: predict, weigh, decide in clusters, and make the frame of what is believed now.
#pragma once

#include <optional>

#include "bernoulli_component.hpp"
#include "bernoulli_prediction.hpp"
#include "bernoulli_shadow.hpp"

namespace trackfield {

struct BernoulliInput {
    double t = 0;
    const double *position = nullptr;    // (n, 2)
    const double *covariance = nullptr;  // (n, 3), NaN: not told
    const int32_t *number = nullptr;
    size_t n = 0;
    int age = 0;      // scans that came after it
    double share = 1; // of its reports that have arrived by now
};

class BernoulliStep {
  public:
    BernoulliStep(const BernoulliModel &model, const BernoulliState &state) : m_(model), s_(state) {}

    BernoulliState run(const BernoulliInput &input) {
        static const Frame kNothing;
        next_ = s_;
        next_.counts = {};
        const bool begun = !s_.frames.empty();
        const Frame &before = begun ? *s_.frames.back() : kNothing;
        Undetected undetected(m_);
        if (begun) {
            const double dt = input.t - before.t, n = std::max(1.0, std::round(dt / m_.step));
            leaves_ = predicted(before, m_, dt, n);
            undetected.load(s_.undetected);
            undetected.predict(dt, n, m_.births >= 0 ? m_.births : next_.births.mean());
        } else {
            undetected.start();
            begin_learning(input.t);
        }
        const double share = m_.p_detection.size() > 1 ? 1 : input.share;  // else told by age
        const double p = next_.p_detection.mean();
        read(input, undetected, share, p);
        const Options options = weigh(leaves_, reports_, m_, share, p, input.age);
        undetected.miss(share, p, input.age);
        next_.undetected = undetected.values();

        const ScanView view{m_, before, leaves_, reports_, options};
        decide(view, input.t);
        learn(share, input.share);
        if (begun) learn_births(before.t, input.t);
        finish(input.t);
        return std::move(next_);
    }

  private:
    const BernoulliModel &m_;
    const BernoulliState &s_;
    BernoulliState next_;
    std::vector<Leaf> leaves_;
    std::vector<BernoulliReport> reports_;
    std::vector<double> unassigned_;
    std::vector<Draft> drafts_;
    std::optional<Shadow> shadow_;  // where the density of false reports is learned
    double clutter_ = 0;  // false reports expected in this scan

    void begin_learning(double t) {
        next_.begun = t;
        next_.births = prior_births();
        next_.shadow.fill({kShadowWeight, kShadowWeight});
        next_.false_reports = {m_.first_false * m_.weight_false, m_.weight_false};
        next_.p_detection = {m_.first_p_detection * m_.weight_p_detection, m_.weight_p_detection};
        next_.variance = {m_.first_sigma * m_.first_sigma * m_.weight_sigma, m_.weight_sigma};
    }

    // Reports in an order that does not depend on how they came, with the densities of their origins.
    void read(const BernoulliInput &in, const Undetected &undetected, double share, double p_learned) {
        const double variance = m_.sigma > 0 ? m_.sigma * m_.sigma : next_.variance.mean();
        const size_t ages = m_.p_detection.size();
        const Map *map = ages ? &m_.p_detection[std::min(size_t(in.age), ages - 1)] : nullptr;
        reports_.resize(in.n);
        for (size_t j = 0; j < in.n; ++j) {
            BernoulliReport &z = reports_[j];
            z.x = in.position[2 * j];
            z.y = in.position[2 * j + 1];
            const double *R = in.covariance + 3 * j;
            z.own_noise = !std::isnan(R[0]);
            z.R = z.own_noise ? Sym2{R[0], R[1], R[2]} : Sym2{variance, 0, variance};
            z.number = in.number[j];
            z.p_detection = share * (map ? map->at(z.x, z.y) : p_learned);
        }
        std::sort(reports_.begin(), reports_.end(), [](const BernoulliReport &a, const BernoulliReport &b) {
            return a.x != b.x ? a.x < b.x : a.y != b.y ? a.y < b.y : a.number < b.number;
        });
        double expected = 0;
        for (const Leaf &leaf : leaves_) expected += leaf.weight * leaf.existence;
        clutter_ = m_.false_per_scan >= 0 ? m_.false_per_scan : next_.false_reports.mean();
        clutter_ *= in.share;
        // A scan with far more reports than targets and false ones explain is a burst of false ones.
        const double n = double(in.n);
        if (n - expected - clutter_ > kBurst * std::sqrt(expected + clutter_ + 1)) {
            clutter_ = n - expected;
            ++next_.counts.burst;
        }
        const bool learned = m_.false_per_scan < 0;
        if (learned) shadow_.emplace(m_, leaves_);
        const auto density = learned ? shadow_->relative(next_.shadow) : std::array<double, kRings>{};
        const double relative = m_.region.area() * mean(m_.false_map);
        for (BernoulliReport &z : reports_) {
            double false_density = clutter_ * m_.false_map.at(z.x, z.y) / relative;
            if (learned) false_density *= density[shadow_->ring(z.x, z.y)];
            false_density = std::max(false_density, kLeastDensity);
            const double first = z.p_detection * undetected.at(z.x, z.y);
            z.rho = false_density + first;
            z.first = first / z.rho;
        }
    }

    static double mean(const Map &map) {
        double total = 0;
        for (double v : map.values) total += v;
        return total / double(map.values.size());
    }

    void decide(const ScanView &view, double t) {
        const size_t C = view.before.clusters.size(), N = reports_.size();
        std::vector<size_t> parent(C);
        std::iota(parent.begin(), parent.end(), size_t(0));
        std::vector<int32_t> owner(N, -1);  // a cluster that may have given the report
        for (size_t c = 0; c < C; ++c) {
            const Cluster &cluster = view.before.clusters[c];
            for (int32_t l = view.before.tracks[cluster.begin].begin; l < view.before.tracks[cluster.end - 1].end; ++l)
                for (int32_t k = view.options.begin[l]; k < view.options.begin[l + 1]; ++k) {
                    const int32_t j = view.options.options[k].report;
                    if (j < 0) continue;
                    if (owner[j] < 0) owner[j] = int32_t(c);
                    else parent[root(parent, c)] = root(parent, size_t(owner[j]));
                }
        }
        std::vector<std::vector<int32_t>> clusters(C), reports(C);
        for (size_t c = 0; c < C; ++c) clusters[root(parent, c)].push_back(int32_t(c));
        for (size_t j = 0; j < N; ++j)
            if (owner[j] >= 0) reports[root(parent, size_t(owner[j]))].push_back(int32_t(j));
        unassigned_.assign(N, 1.0);
        Component component(view, t);
        for (size_t c = 0; c < C; ++c) {
            if (clusters[c].empty()) continue;
            if (reports[c].empty() && unambiguous(view.before.clusters[c])) {
                miss(view, view.before.clusters[c]);
                continue;
            }
            const int64_t left = std::max<int64_t>(m_.work - next_.counts.work, 0);
            Resolved found = component.resolve(clusters[c], reports[c], std::min(left, m_.cluster_work));
            next_.counts.work += found.work;
            ++(found.propagated ? next_.counts.propagated : next_.counts.enumerated);
            for (size_t j = 0; j < reports[c].size(); ++j) unassigned_[reports[c][j]] = found.unassigned[j];
            for (Draft &draft : found.drafts) settle(std::move(draft));
        }
        for (size_t j = 0; j < N; ++j)
            if (owner[j] < 0 && reports_[j].first >= m_.least_existence) drafts_.push_back(alone(newborn(view, int32_t(j), t)));
    }

    static bool unambiguous(const Cluster &cluster) { return cluster.tracks() == 1 && cluster.weight.size() == 1; }

    // Most possible targets are lone reports of some scans ago: nothing to decide on.
    void miss(const ScanView &view, const Cluster &cluster) {
        const Track &track = view.before.tracks[cluster.begin];
        Leaf leaf = grown(view, track.begin, view.options.missed(track.begin));
        if (leaf.existence >= m_.least_existence) drafts_.push_back(alone({track.id, track.first, {leaf}}));
        ++next_.counts.work;
    }

    void settle(Draft &&draft) {
        const bool lone = draft.tracks.size() == 1;
        settle_hypotheses(draft, m_.least_weight, size_t(m_.hypotheses));
        settle_weights(draft);
        if (merge_alike(draft, m_.recent)) {
            settle_hypotheses(draft, m_.least_weight, size_t(m_.hypotheses));
            settle_weights(draft);
        }
        drop_unlikely(draft, m_.least_existence);
        if (draft.tracks.empty()) return;
        merge_duplicates(draft, m_.duplicates);
        if (lone) {
            drafts_.push_back(std::move(draft));
            return;
        }
        for (Draft &part : parted(std::move(draft), m_)) {
            settle_hypotheses(part, m_.least_weight, size_t(m_.hypotheses));
            settle_weights(part);
            drafts_.push_back(std::move(part));
        }
    }

    // Lays everything out; the least likely go where there are too many.
    void finish(double t) {
        size_t count = 0;
        for (const Draft &d : drafts_) count += d.tracks.size();
        if (count > size_t(m_.max_tracks)) {
            std::vector<double> all;
            for (const Draft &d : drafts_)
                for (const DraftTrack &track : d.tracks) all.push_back(existence(track));
            const size_t out = count - size_t(m_.max_tracks);
            std::nth_element(all.begin(), all.begin() + out - 1, all.end());
            const double least = std::nextafter(all[out - 1], 2.0);
            for (Draft &d : drafts_) drop_unlikely(d, least);
            next_.counts.crowded_out = int64_t(out);
        }
        auto frame = std::make_shared<Frame>();
        frame->t = t;
        for (Draft &d : drafts_) {
            if (d.tracks.empty()) continue;
            Cluster cluster;
            cluster.begin = int32_t(frame->tracks.size());
            std::vector<int32_t> offset;
            for (DraftTrack &track : d.tracks) {
                const int32_t begin = int32_t(frame->leaves.size());
                offset.push_back(begin);
                frame->leaves.insert(frame->leaves.end(), track.leaves.begin(), track.leaves.end());
                frame->tracks.push_back({track.id, begin, int32_t(frame->leaves.size()), track.first});
            }
            cluster.end = int32_t(frame->tracks.size());
            cluster.weight = std::move(d.weight);
            cluster.leaf = std::move(d.choice);
            const size_t n = offset.size();
            for (size_t k = 0; k < cluster.leaf.size(); ++k)
                if (cluster.leaf[k] >= 0) cluster.leaf[k] += offset[k % n];
            frame->clusters.push_back(std::move(cluster));
        }
        next_.frames.push_back(std::move(frame));
        if (next_.frames.size() > size_t(m_.history) + 1) next_.frames.erase(next_.frames.begin());
    }

    // Expected numbers of false reports, of detections of sure targets, of squared residuals.
    void learn(double share, double arrived) {
        double found_false = 0;
        for (size_t j = 0; j < reports_.size(); ++j) found_false += unassigned_[j] * (1 - reports_[j].first);
        if (shadow_) {
            std::array<double, kRings> found{};
            for (size_t j = 0; j < reports_.size(); ++j)
                found[shadow_->ring(reports_[j].x, reports_[j].y)] += unassigned_[j] * (1 - reports_[j].first);
            for (int r = 0; r < kRings; ++r) next_.shadow[r].add(found[r], found_false * shadow_->share(r), m_.memory_false);
        }
        next_.false_reports.add(found_false / std::max(arrived, 1e-6), 1, m_.memory_false);
        double detected = 0, there = 0, squares = 0, residuals = 0;
        for (const Draft &d : drafts_)
            for (const DraftTrack &track : d.tracks) {
                double r_before = 0, r = 0, seen = 0;
                for (const Leaf &leaf : track.leaves) {
                    if (leaf.parent >= 0) r_before += leaf.weight * leaves_[leaf.parent].existence;
                    r += leaf.weight * leaf.existence;
                    if (leaf.report() >= 0) seen += leaf.weight;
                }
                if (r_before < kSure) continue;
                if (r_before >= kSurest) {
                    detected += seen;
                    there += r;
                }
                for (const Leaf &leaf : track.leaves) {
                    if (leaf.report() < 0) continue;
                    auto z = std::find_if(reports_.begin(), reports_.end(), [&](const BernoulliReport &o) { return o.number == leaf.report(); });
                    if (z->own_noise) continue;
                    const double ex = z->x - leaf.state.x, ey = z->y - leaf.state.y;
                    squares += leaf.weight * (ex * ex + ey * ey + leaf.state.A.trace()) / 2;
                    residuals += leaf.weight;
                }
            }
        next_.p_detection.add(detected, there * share, m_.memory_p_detection);
        next_.variance.correct(squares, residuals, m_.memory_sigma, kPace);
    }

    Learned prior_births() const { return {m_.weight_births, m_.weight_births / m_.first_births}; }

    // Targets that have come, each counted when what followed has shown whether it is one; what is known
    // before the first scan is not forgotten, so that nothing to see for hours does not rule a target out.
    void learn_births(double t_before, double t) {
        const double wait = (kShownBy - 0.5) * m_.step;
        if (t - next_.begun < wait) return;
        double born = 0;
        for (const Draft &d : drafts_)
            for (const DraftTrack &track : d.tracks)
                if (track.first > next_.begun && t - track.first >= wait && t_before - track.first < wait) born += existence(track);
        const Learned prior = prior_births();
        Learned found{next_.births.sum - prior.sum, next_.births.weight - prior.weight};
        found.add(born, std::max(1.0, std::round((t - t_before) / m_.step)), m_.memory_births);
        next_.births = {found.sum + prior.sum, found.weight + prior.weight};
    }

    static constexpr double kShownBy = 4;         // steps after its first report a target is one or not
    static constexpr double kBurst = 5;           // sigmas
    static constexpr double kLeastDensity = 1e-12;
    // Existence of targets that tell of noise, and of detection: whoever doubts more takes misses for ends.
    static constexpr double kSure = 0.9, kSurest = 0.97;
    static constexpr double kShadowWeight = 5;
    static constexpr double kPace = 4;            // of learning the noise
};

}  // namespace trackfield
