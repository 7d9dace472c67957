// The best k of n sensors: exchanges, a bound from the relaxation, and a tree that closes the gap.
#pragma once

#include "selection_relaxation.hpp"
#include "selection_swaps.hpp"
#include "selection_tree.hpp"

namespace trackfield::selection {

// Relax, for thousands of sensors on those that score most, until no other one could have a share.
template <int D>
struct Relaxed {
    std::vector<double> share;
    double value = kNothing;
    Cut<D> cut;
};

template <int D>
Relaxed<D> relax(const Field<D> &field, const Limits &limits, double ridge, double tolerance, const Packed<D> &near) {
    constexpr int kPool = 128, kRounds = 4;
    const auto whole = [&]() -> Relaxed<D> {
        Relaxation<D> all(field, limits, ridge);
        all.solve(tolerance);
        return {std::move(all.share), all.value, all.cut};
    };
    if (field.n <= 2 * kPool || limits.rows == 2 || limits.most[0] > kPool / 2) return whole();
    Relaxed<D> out;
    Packed<D> slope;  // of the trace, whatever the criterion: it values all directions
    {
        const Spectrum<D> spectrum(near);
        std::array<double, D> roots{};
        for (int a = 0; a < D; ++a) roots[a] = 1.0 / (spectrum.roots[a] * spectrum.roots[a]);
        slope = spectrum.with(roots);
    }
    std::vector<uint8_t> inside(field.n, 0);
    std::vector<std::pair<double, int32_t>> rank;
    Set pool;
    for (int round = 0; round < kRounds; ++round) {
        rank.clear();
        for (int i = 0; i < field.n; ++i)
            if (const double score = slope.quadratic(field.gain(i, 0)); !inside[i]) rank.push_back({std::isfinite(score) ? score : 0.0, i});
        const int more = std::min<int>(kPool, int(rank.size()));
        std::nth_element(rank.begin(), rank.begin() + more, rank.end(), std::greater<>());
        for (int p = 0; p < more; ++p) inside[rank[p].second] = 1, pool.push_back(rank[p].second);
        const Field<D> part = field.part(pool);
        Relaxation<D> some(part, limits, ridge);
        some.solve(tolerance);
        slope = some.cut.slope;
        const Cut<D> cut = tangent(slope, field, limits, field.start(ridge)[0], 0.0);
        if (cut.bound < out.cut.bound) out.cut = cut;
        out.value = some.value;
        out.share.assign(field.n, 0.0);
        for (size_t p = 0; p < pool.size(); ++p) out.share[pool[p]] = some.share[p];
        if (!(out.cut.bound - out.value > 2.0 * tolerance * some.scale())) return out;
    }
    return whole();
}

template <int D>
struct Found {
    Set set;
    Cut<D> cut;
    bool complete = false;
};

template <int D>
Found<D> search(const Field<D> &field, int k, double ridge, int64_t work) {
    Limits limits;
    limits.most[0] = k;
    Swaps<D> swaps(field, ridge);
    Found<D> found{swaps.greedy(k), {}};
    double value = swaps.improve(found.set);
    const Relaxed<D> relaxed = relax(field, limits, ridge, 1e-5, field.state_of(found.set, ridge)[0]);
    Set rounded(field.n);
    std::iota(rounded.begin(), rounded.end(), 0);
    std::nth_element(rounded.begin(), rounded.begin() + k - 1, rounded.end(), [&](int a, int b) { return relaxed.share[a] > relaxed.share[b]; });
    rounded.resize(k);
    const double other = swaps.improve(rounded);
    if (other > value) value = other, found.set = rounded;
    found.cut = relaxed.cut;
    if (!found.cut.sound()) return found;
    Bounded bounded{relaxed.cut.constant, std::vector<double>(field.n)};
    for (int i = 0; i < field.n; ++i) bounded.score[i] = relaxed.cut.score(field.gain(i, 0));
    Tree<D> tree(field, bounded, k, ridge);
    tree.improve(found.set, value, work);
    found.complete = tree.complete;
    return found;
}

}  // namespace trackfield::selection
