// All passes that explain the messages nearly as well as the best one does, with their weights.
#pragma once
#include <numeric>

#include "passes_starts.hpp"

namespace trackfield::passes {

struct Search {
    int pairs_of = 4;        // pairs of so many sensors, the loudest
    int searched = 6;        // starts that are searched from: the best, or others in place of what leads nowhere new
    bool printed = false;    // neither the linear start nor the mirror image
    int patience = 3;        // searches in a row that lead nowhere new
    int steps = 150;         // of each search
    double done = 1e-7;      // promised gain of half the deviance at which a search ends
    double within = 12.0;    // half the deviance by which a mode may be worse than the best
    double least = 1e-3;     // weight of a mode that is told
    double far = 100.0;      // the same for starts beyond the best ones and for the mirror image, before a search
};

struct Mode {
    Fit fit;
    double log_weight = 0.0;
};

// exp(-half) times N(0, 1) in field radii for the line of motion's distance from the middle of the sensors: what we look
// for goes through the field. The determinant of Laplace's rule and a prior of the speed were tried: on drawn passes they
// chose wrongly more often, because modes of large volume are the far, fast, loud ones.
inline double log_weight(const Fit &fit) {
    const double aside = fit.state[1] * std::sin(fit.state[4]) - fit.state[2] * std::cos(fit.state[4]);
    return -fit.half - 0.5 * aside * aside;
}

// Squared distance of two states in standard deviations of one of them.
inline double apart(const Square &F, const Column &a, const Column &b, int n) {
    double sum = 0.0;
    Column d{};
    for (int i = 0; i < n; ++i) d[i] = a[i] - b[i];
    d[4] = std::remainder(d[4], 2.0 * std::numbers::pi);
    for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) sum += d[i] * F[i][j] * d[j];
    return sum;
}

// Mirror image in the main axis of the sensors, which for sensors in a line is as good.
inline Column mirrored(const Pass &pass, const Column &s) {
    double xx = 0.0, xy = 0.0, yy = 0.0;
    for (const Message &m : pass.messages) xx += m.x * m.x, xy += m.x * m.y, yy += m.y * m.y;
    const double axis = 0.5 * std::atan2(2.0 * xy, xx - yy), c = std::cos(2.0 * axis), d = std::sin(2.0 * axis);
    Column out = s;
    out[1] = c * s[1] + d * s[2], out[2] = d * s[1] - c * s[2], out[4] = 2.0 * axis - s[4];
    return out;
}

inline std::vector<Column> starts(const Pass &pass, const Search &search) {
    std::vector<size_t> order(pass.messages.size());
    std::iota(order.begin(), order.end(), 0);
    std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) { return pass.messages[a].loudness() > pass.messages[b].loudness(); });
    order.resize(std::min(order.size(), size_t(search.pairs_of)));
    std::vector<Column> all;
    Column linear;
    if (!search.printed && lifted(pass, linear)) all.push_back(linear);
    for (size_t j = 1; j < order.size(); ++j)
        for (size_t i = 0; i < j; ++i) pair(pass.messages[order[i]], pass.messages[order[j]], pass.alpha, all);
    return all;
}

struct Start {
    double half;
    size_t place;
    bool operator<(const Start &other) const { return half < other.half; }
};

// The `most` best of some starts, best first.
inline std::vector<Start> ranked(const Pass &pass, const std::vector<Column> &all, size_t most) {
    std::vector<Start> best;
    for (size_t i = 0; i < all.size(); ++i) {
        const double limit = best.size() < most ? std::numeric_limits<double>::infinity() : best.back().half;
        const Start start{pass.half(all[i], limit), i};
        if (!(start.half < limit)) continue;
        best.insert(std::upper_bound(best.begin(), best.end(), start), start);
        if (best.size() > most) best.pop_back();
    }
    return best;
}

enum class Outcome { skipped, known, fresh };

// Searches from a start, unless it lies at a mode that is known; what leads to one is given up on the way.
inline Outcome add(const Pass &pass, const Search &search, const Column &start, std::vector<Mode> &modes) {
    const auto near = [&](const Column &state, double limit) {
        return std::ranges::any_of(modes, [&](const Mode &m) { return m.fit.converged && apart(m.fit.F, m.fit.state, state, pass.n) < limit; });
    };
    if (near(start, 4.0)) return Outcome::skipped;
    const Fit fit = pass.descend(start, search.steps, search.done, [&](const Column &state) { return near(state, 1.0); });
    if (!std::isfinite(fit.half)) return Outcome::known;
    for (Mode &mode : modes)
        if (std::min(apart(mode.fit.F, mode.fit.state, fit.state, pass.n), apart(fit.F, mode.fit.state, fit.state, pass.n)) < 0.5) {
            if (fit.half < mode.fit.half) mode.fit = fit;
            return Outcome::known;
        }
    modes.push_back({fit});
    return Outcome::fresh;
}

// Modes by falling weight; `log_weight` is relative to their sum.
inline std::vector<Mode> modes(const Pass &pass, const Search &search) {
    std::vector<Mode> found;
    const auto best_fit = [&]() -> const Fit & { return std::ranges::min_element(found, {}, [](const Mode &m) { return m.fit.half; })->fit; };
    const std::vector<Column> all = starts(pass, search);
    const std::vector<Start> order = ranked(pass, all, size_t(search.printed ? 1 : 4 * search.searched));
    int searches = 0, idle = 0;
    for (int i = 0; i < int(order.size()) && searches < search.searched && idle < search.patience; ++i) {
        if (i >= search.searched && !found.empty() && order[size_t(i)].half > best_fit().half + search.far) break;
        const Outcome outcome = add(pass, search, all[order[size_t(i)].place], found);
        searches += outcome != Outcome::skipped;
        idle = outcome == Outcome::fresh ? 0 : idle + (outcome == Outcome::known);
    }
    if (found.empty()) return found;
    const Column image = mirrored(pass, best_fit().state);
    if (const double limit = best_fit().half + search.far; !search.printed && pass.half(image, limit) < limit) add(pass, search, image, found);
    const double best = best_fit().half;
    std::erase_if(found, [&](const Mode &m) { return m.fit.half > best + search.within; });
    for (Mode &m : found) m.log_weight = log_weight(m.fit);
    std::stable_sort(found.begin(), found.end(), [](const Mode &a, const Mode &b) { return a.log_weight > b.log_weight; });
    const double top = found[0].log_weight, least = top + std::log(search.least);
    std::erase_if(found, [&](const Mode &m) { return m.log_weight < least; });
    double sum = 0.0;
    for (const Mode &m : found) sum += std::exp(m.log_weight - top);
    for (Mode &m : found) m.log_weight -= top + std::log(sum);
    return found;
}

}  // namespace trackfield::passes
