// What a chain of partitions is about: the reports of a window, and which may follow which in a track.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "mcmcda_belief.hpp"

namespace trackfield::mcmcda {

constexpr int kMoves = 8;
constexpr int kMostSlots = 64;
enum Move { kBirth, kDeath, kSplit, kMerge, kExtension, kReduction, kUpdate, kSwitch };

// Python gives every number (association/mcmcda.py).
struct Settings {
    double velocity_variance = 1;  // of a target when first seen, per axis
    double max_speed = 0;          // of links [m/s]
    double margin = 0;             // of links, in standard deviations of both reports
    double stop = 0;               // gamma: of the suffix process
    std::vector<double> gaps;      // zeta: probability to look d = 1, 2, ... slots ahead
    std::array<double, kMoves> moves{};  // weights of the moves
    bool informed = true;
    bool marginal_death = true;    // else a death costs log_death, if there is a slot after it
    double log_death = 0;
    std::array<double, 4> region{-INFINITY, -INFINITY, INFINITY, INFINITY};  // targets that leave it end
    int frozen = 0;                // slots at the start of the window whose tracks must stay
};

// `to` may follow in a track; `constant` is all of the log posterior that the link brings but for the
// density of the report: misses between, survival, detection, one false alarm less.
struct Link {
    int32_t to;
    double constant;
    double factor;  // exp(constant)
};

struct Links {
    const Link *first, *last;
    const Link *begin() const { return first; }
    const Link *end() const { return last; }
};

class Window {
  public:
    Settings set;
    std::vector<Report> reports;
    std::vector<double> log_birth, log_false, detection, survival, times;
    std::vector<int> slot_begin;  // reports of slot t are slot_begin[t] .. slot_begin[t + 1] - 1

    int slots() const { return int(times.size()); }
    int size() const { return int(reports.size()); }
    int reach() const { return int(set.gaps.size()); }
    double detected(int slot, int i) const { return detection[size_t(slot) * size() + i]; }
    const Gap &gap(int from, int to) const { return gaps_[size_t(from) * slots() + to]; }

    // Reports d slots after report i that may follow it.
    Links after(int i, int d) const {
        const size_t at = size_t(i) * reach() + d - 1;
        return {links_.data() + link_begin_[at], links_.data() + link_begin_[at + 1]};
    }

    // All reports that may follow i, nearest slot first.
    Links after(int i) const {
        const size_t at = size_t(i) * reach();
        return {links_.data() + link_begin_[at], links_.data() + link_begin_[at + reach()]};
    }

    // Reports that j may follow.
    const std::vector<int32_t> &before(int j) const { return before_[j]; }

    // Link from i to j, or null.
    const Link *find(int i, int j) const {
        const int d = reports[j].slot - reports[i].slot;
        if (d < 1 || d > reach()) return nullptr;
        const Links some = after(i, d);
        const Link *at = std::lower_bound(some.first, some.last, j, [](const Link &l, int to) { return l.to < to; });
        return at != some.last && at->to == j ? at : nullptr;
    }

    size_t links() const { return links_.size(); }
    size_t number(const Link &link) const { return size_t(&link - links_.data()); }

    // Log posterior that the first report of a track brings.
    double first(int i) const { return first_[i]; }

    // Probability that a track whose last report is i was not seen again, had it no border to cross.
    double silence(int i) const { return silence_[i]; }

    // Log posterior of the end of a track with last report i.
    template <class Belief>
    double ending(int i, const Belief &belief) const {
        const int slot = reports[i].slot, left = slots() - 1 - slot;
        if (left == 0) return 0;
        if (!set.marginal_death) return set.log_death;
        if (stays_inside(slot, belief)) return log_silence_[i];
        Belief now = belief;
        double seen_off = 0, alive = 1;  // ended and never seen; alive and not seen
        for (int t = slot + 1; t < slots(); ++t) {
            now.predict(gap(t - 1, t));
            const double s = survival[t] * inside(now);
            seen_off += alive * (1 - s);
            alive *= s * (1 - detected(t, i));
        }
        return std::log(std::max(seen_off + alive, 1e-300));
    }

    // Build everything that follows from reports, times, probabilities and settings.
    void prepare(double accel_variance, double step) {
        const int T = slots();
        gaps_.resize(size_t(T) * T);
        for (int t = 1; t < T; ++t) {
            const Gap one = motion(times[t] - times[t - 1], accel_variance, step);
            for (int s = 0; s < t; ++s) gaps_[size_t(s) * T + t] = then(gaps_[size_t(s) * T + t - 1], one);
        }
        slot_begin.assign(T + 1, 0);
        for (const Report &r : reports) ++slot_begin[r.slot + 1];
        for (int t = 0; t < T; ++t) slot_begin[t + 1] += slot_begin[t];
        silences();
        link();
    }

    // Motion over dt with a constant acceleration in each of its dt / step steps, Oh (6).
    static Gap motion(double dt, double accel_variance, double step) {
        const double m = std::max(1.0, dt / step), h = dt / m, q = accel_variance * h * h;
        return {dt, q * h * h * m * (m * m / 3 - 1.0 / 12), q * h * m * m / 2, q * m};
    }

    // Motion over one gap and then another.
    static Gap then(const Gap &a, const Gap &b) {
        return {a.dt + b.dt, a.pp + b.dt * (2 * a.pv + b.dt * a.vv) + b.pp, a.pv + b.dt * a.vv + b.pv, a.vv + b.vv};
    }

  private:
    std::vector<Gap> gaps_;
    std::vector<Link> links_;
    std::vector<size_t> link_begin_;
    std::vector<std::vector<int32_t>> before_;
    std::vector<int32_t> by_x_;
    std::vector<double> widest_;
    std::vector<double> first_, silence_, log_silence_;

    void silences() {
        const int n = size(), T = slots();
        first_.resize(n);
        silence_.resize(n);
        log_silence_.resize(n);
        for (int i = 0; i < n; ++i) {
            const int slot = reports[i].slot;
            first_[i] = log_birth[i] + std::log(detected(slot, i)) - log_false[i];
            double ended = 0, alive = 1;
            for (int t = slot + 1; t < T; ++t) {
                ended += alive * (1 - survival[t]);
                alive *= survival[t] * (1 - detected(t, i));
            }
            silence_[i] = ended + alive;
            log_silence_[i] = std::log(std::max(silence_[i], 1e-300));
        }
    }

    void link() {
        const int n = size(), T = slots(), D = reach();
        sort_by_x();
        link_begin_.assign(size_t(n) * D + 1, 0);
        before_.assign(n, {});
        links_.clear();
        for (int i = 0; i < n; ++i) {
            const Report &a = reports[i];
            double misses = 0;
            for (int d = 1; d <= D; ++d) {
                const int t = a.slot + d;
                if (t < T) {
                    misses += std::log(survival[t]);
                    follow(i, t, misses);
                    misses += std::log(1 - detected(t, i));
                }
                link_begin_[size_t(i) * D + d] = links_.size();
            }
        }
    }

    // Reports of every slot from west to east, so that few have to be looked at.
    void sort_by_x() {
        by_x_.resize(size());
        for (int i = 0; i < size(); ++i) by_x_[i] = i;
        widest_.assign(slots(), 0);
        for (const Report &r : reports) widest_[r.slot] = std::max(widest_[r.slot], width(r));
        for (int t = 0; t < slots(); ++t)
            std::sort(by_x_.begin() + slot_begin[t], by_x_.begin() + slot_begin[t + 1], [&](int i, int j) { return reports[i].x < reports[j].x; });
    }

    void follow(int i, int t, double misses) {
        const Report &a = reports[i];
        const double far = set.max_speed * (times[t] - times[a.slot]), sigma = width(a);
        const double widest = far + set.margin * (sigma + widest_[t]);
        const auto end = by_x_.begin() + slot_begin[t + 1];
        auto at = std::lower_bound(by_x_.begin() + slot_begin[t], end, a.x - widest, [&](int j, double x) { return reports[j].x < x; });
        const size_t first = links_.size();
        for (; at != end && reports[*at].x <= a.x + widest; ++at) {
            const Report &b = reports[*at];
            const double dx = b.x - a.x, dy = b.y - a.y, most = far + set.margin * (sigma + width(b));
            if (dx * dx + dy * dy > most * most) continue;
            const double constant = misses + std::log(detected(t, *at)) - log_false[*at];
            links_.push_back({*at, constant, std::exp(constant)});
            before_[*at].push_back(i);
        }
        std::sort(links_.begin() + first, links_.end(), [](const Link &l, const Link &m) { return l.to < m.to; });
    }

    static double width(const Report &r) { return std::sqrt((r.xx + r.yy) / 2); }

    // Probability that one coordinate lies between two borders.
    static double between(double mean, double sigma, double low, double high) {
        const double scale = 1 / (sigma * std::sqrt(2.0));
        return 0.5 * (std::erfc((mean - high) * scale) - std::erfc((mean - low) * scale));
    }

    template <class Belief>
    double inside(const Belief &b) const {
        return between(b.x, b.sigma_x(), set.region[0], set.region[2]) *
               between(b.y, b.sigma_y(), set.region[1], set.region[3]);
    }

    // Whether 6 sigma of every later position lie inside: mean and sigma are extreme at the ends.
    template <class Belief>
    bool stays_inside(int slot, const Belief &belief) const {
        if (std::isinf(set.region[0])) return true;
        Belief last = belief;
        last.predict(gap(slot, slots() - 1));
        const double dt = gap(slot, slot + 1).dt, x = belief.x + dt * belief.u, y = belief.y + dt * belief.v;
        const double rx = 6 * last.sigma_x(), ry = 6 * last.sigma_y();
        return std::min(x, last.x) - rx > set.region[0] && std::max(x, last.x) + rx < set.region[2] &&
               std::min(y, last.y) - ry > set.region[1] && std::max(y, last.y) + ry < set.region[3];
    }
};

}  // namespace trackfield::mcmcda
