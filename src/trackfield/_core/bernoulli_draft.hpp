// A cluster being made: alike histories become one, impossible ones go, strangers part.
#pragma once

#include <numeric>

#include "bernoulli_frame.hpp"

namespace trackfield {

struct DraftTrack {
    int32_t id = 0;
    double first = 0;
    std::vector<Leaf> leaves;  // their weights are the marginals of the hypotheses
};

struct Draft {
    std::vector<DraftTrack> tracks;
    std::vector<double> weight;
    std::vector<int32_t> choice;  // (hypotheses, tracks): place among the track's leaves, -1: no such target

    size_t size() const { return weight.size(); }
    int32_t *row(size_t h) { return choice.data() + h * tracks.size(); }
    const int32_t *row(size_t h) const { return choice.data() + h * tracks.size(); }
};

inline double existence(const DraftTrack &track) {
    double r = 0;
    for (const Leaf &leaf : track.leaves) r += leaf.weight * leaf.existence;
    return r;
}

// Weights of leaves from those of hypotheses; leaves that no hypothesis names go.
inline void settle_weights(Draft &d) {
    const size_t n = d.tracks.size();
    std::vector<int32_t> place;
    for (size_t i = 0; i < n; ++i) {
        std::vector<Leaf> &leaves = d.tracks[i].leaves;
        for (Leaf &leaf : leaves) leaf.weight = 0;
        for (size_t h = 0; h < d.size(); ++h)
            if (d.row(h)[i] >= 0) leaves[d.row(h)[i]].weight += d.weight[h];
        place.assign(leaves.size(), -1);
        int32_t kept = 0;
        for (size_t k = 0; k < leaves.size(); ++k)
            if (leaves[k].weight > 0) {
                place[k] = kept;
                if (size_t(kept) != k) leaves[kept] = leaves[k];
                ++kept;
            }
        if (size_t(kept) == leaves.size()) continue;
        leaves.resize(kept);
        for (size_t h = 0; h < d.size(); ++h)
            if (d.row(h)[i] >= 0) d.row(h)[i] = place[d.row(h)[i]];
    }
}

// Hypotheses that say the same become one; the unlikely go; likeliest first.
inline void settle_hypotheses(Draft &d, double least, size_t most) {
    const size_t n = d.tracks.size(), H = d.size();
    std::vector<size_t> order(H);
    std::iota(order.begin(), order.end(), size_t(0));
    auto compare = [&](size_t a, size_t b) {
        const int32_t *x = d.row(a), *y = d.row(b);
        for (size_t i = 0; i < n; ++i)
            if (x[i] != y[i]) return x[i] < y[i] ? -1 : 1;
        return 0;
    };
    std::sort(order.begin(), order.end(), [&](size_t a, size_t b) {
        const int c = compare(a, b);
        return c ? c < 0 : a < b;
    });
    std::vector<std::pair<double, size_t>> unique;
    for (size_t k = 0; k < H; ++k) {
        if (k && compare(order[k], order[k - 1]) == 0) unique.back().first += d.weight[order[k]];
        else unique.push_back({d.weight[order[k]], order[k]});
    }
    std::sort(unique.begin(), unique.end(), [](auto &a, auto &b) { return a.first != b.first ? a.first > b.first : a.second < b.second; });
    size_t kept = 0;
    double total = 0;
    while (kept < unique.size() && kept < most && unique[kept].first >= least * unique[0].first) total += unique[kept++].first;
    std::vector<double> weight(kept);
    std::vector<int32_t> choice(kept * n);
    for (size_t k = 0; k < kept; ++k) {
        weight[k] = unique[k].first / total;
        std::copy_n(d.row(unique[k].second), n, choice.begin() + k * n);
    }
    d.weight.swap(weight);
    d.choice.swap(choice);
}

inline bool alike(const Leaf &a, const Leaf &b, int recent) {
    return std::equal(a.recent.begin(), a.recent.begin() + recent, b.recent.begin());
}

inline bool silent(const Leaf &leaf, int recent) {
    return std::all_of(leaf.recent.begin(), leaf.recent.begin() + recent, [](int32_t z) { return z < 0; });
}

// One leaf with the moments of several, which weigh `weight`; the heaviest passes on its past.
inline Leaf merged(const std::vector<const Leaf *> &group, double weight) {
    Leaf leaf = *group[0];
    if (group.size() > 1) {
        Moments moments;
        double heaviest = -1;
        for (const Leaf *other : group) {
            const double w = other->weight * other->existence;
            moments.add(other->state, w);
            if (w > heaviest) {
                heaviest = w;
                leaf = *other;
            }
        }
        leaf.state = moments.mixed();
    }
    double r = 0;
    for (const Leaf *other : group) r += other->weight * other->existence;
    leaf.existence = std::min(r / weight, 1.0);
    leaf.weight = weight;
    return leaf;
}

// Histories of a track that agree on their last scans become one; "no such target" agrees with silence.
// Tells whether any did.
inline bool merge_alike(Draft &d, int recent) {
    bool any = false;
    const size_t n = d.tracks.size();
    for (size_t i = 0; i < n; ++i) {
        std::vector<Leaf> &leaves = d.tracks[i].leaves;
        double present = 0;
        for (const Leaf &leaf : leaves) present += leaf.weight;
        const double absent = std::max(0.0, 1 - present);
        const bool any_absent = absent > 1e-12;
        if (leaves.size() < 2 && !(any_absent && !leaves.empty() && silent(leaves[0], recent))) continue;
        std::vector<int32_t> place(leaves.size(), -1);
        std::vector<Leaf> kept;
        int32_t quiet = -1;
        for (size_t k = 0; k < leaves.size(); ++k) {
            if (place[k] >= 0) continue;
            std::vector<const Leaf *> group;
            double weight = 0;
            for (size_t m = k; m < leaves.size(); ++m)
                if (place[m] < 0 && alike(leaves[k], leaves[m], recent)) {
                    place[m] = int32_t(kept.size());
                    group.push_back(&leaves[m]);
                    weight += leaves[m].weight;
                }
            if (any_absent && silent(leaves[k], recent)) {
                quiet = int32_t(kept.size());
                weight += absent;
            }
            kept.push_back(merged(group, weight));
        }
        if (kept.size() == leaves.size() && quiet < 0) continue;
        any = true;
        leaves.swap(kept);
        for (size_t h = 0; h < d.size(); ++h) {
            int32_t &c = d.row(h)[i];
            c = c >= 0 ? place[c] : quiet;
        }
    }
    return any;
}

// Tracks that hardly exist go.
inline void drop_unlikely(Draft &d, double least) {
    const size_t n = d.tracks.size();
    std::vector<char> keep(n);
    size_t left = 0;
    for (size_t i = 0; i < n; ++i) left += keep[i] = existence(d.tracks[i]) >= least;
    if (left == n) return;
    size_t at = 0;
    for (size_t h = 0; h < d.size(); ++h)
        for (size_t i = 0; i < n; ++i)
            if (keep[i]) d.choice[at++] = d.choice[h * n + i];
    d.choice.resize(at);
    size_t to = 0;
    for (size_t i = 0; i < n; ++i)
        if (keep[i]) {
            if (to != i) d.tracks[to] = std::move(d.tracks[i]);
            ++to;
        }
    d.tracks.resize(to);
}

inline const Leaf &likeliest(const std::vector<Leaf> &leaves) {
    return *std::max_element(leaves.begin(), leaves.end(), [](const Leaf &a, const Leaf &b) {
        return a.weight * a.existence < b.weight * b.existence;
    });
}

inline int32_t last_report(const Leaf &leaf) {
    for (int32_t z : leaf.recent)
        if (z >= 0) return z;
    return -1;
}

// Two tracks whose likeliest histories share their last report, and which hardly ever are both there, are
// one target under two names: the older name takes it.
inline void merge_duplicates(Draft &d, double share) {
    for (size_t a = 0; a < d.tracks.size(); ++a)
        for (size_t b = a + 1; b < d.tracks.size(); ++b) {
            const int32_t z = last_report(likeliest(d.tracks[a].leaves));
            if (z < 0 || z != last_report(likeliest(d.tracks[b].leaves))) continue;
            double both = 0;
            for (size_t h = 0; h < d.size(); ++h) {
                const int32_t i = d.row(h)[a], j = d.row(h)[b];
                if (i >= 0 && j >= 0)
                    both += d.weight[h] * d.tracks[a].leaves[i].existence * d.tracks[b].leaves[j].existence;
            }
            if (both > share * std::min(existence(d.tracks[a]), existence(d.tracks[b]))) continue;
            const bool first_is_older = d.tracks[a].id < d.tracks[b].id;
            const size_t to = first_is_older ? a : b, from = first_is_older ? b : a, n = d.tracks.size();
            std::vector<Leaf> &leaves = d.tracks[to].leaves;
            const int32_t own = int32_t(leaves.size());
            leaves.insert(leaves.end(), d.tracks[from].leaves.begin(), d.tracks[from].leaves.end());
            size_t at = 0;
            for (size_t h = 0; h < d.size(); ++h) {
                int32_t *row = d.choice.data() + h * n;
                const int32_t i = row[to], j = row[from];
                if (j >= 0 && (i < 0 || leaves[i].existence < leaves[own + j].existence)) row[to] = own + j;
                for (size_t k = 0; k < n; ++k)
                    if (k != from) d.choice[at++] = row[k];
            }
            d.choice.resize(at);
            d.tracks.erase(d.tracks.begin() + from);
            settle_weights(d);
            b = a;  // the next pair of a again
            if (from == a) {
                a = size_t(-1);
                break;
            }
        }
}

// Total variation between the joint choice of two tracks and independent choices.
inline double dependence(const Draft &d, size_t a, size_t b, std::vector<double> &table) {
    const size_t A = d.tracks[a].leaves.size() + 1, B = d.tracks[b].leaves.size() + 1;
    table.assign(A * B + A + B, 0.0);
    double *of_a = table.data() + A * B, *of_b = of_a + A;
    for (size_t h = 0; h < d.size(); ++h) {
        const size_t i = size_t(d.row(h)[a] + 1), j = size_t(d.row(h)[b] + 1);
        table[i * B + j] += d.weight[h];
        of_a[i] += d.weight[h];
        of_b[j] += d.weight[h];
    }
    double total = 0;
    for (size_t i = 0; i < A; ++i)
        for (size_t j = 0; j < B; ++j) total += std::abs(table[i * B + j] - of_a[i] * of_b[j]);
    return total / 2;
}

inline size_t root(std::vector<size_t> &parent, size_t i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
}

// Parts a cluster into groups that (nearly) do not depend on each other.
inline std::vector<Draft> parted(Draft &&d, const BernoulliModel &model) {
    const size_t n = d.tracks.size();
    std::vector<Draft> parts;
    std::vector<size_t> parent(n);
    std::iota(parent.begin(), parent.end(), size_t(0));
    std::vector<char> open(n);
    for (size_t i = 0; i < n; ++i) {
        bool varies = false;
        for (size_t h = 1; h < d.size() && !varies; ++h) varies = d.row(h)[i] != d.row(0)[i];
        open[i] = varies && existence(d.tracks[i]) >= model.joined_existence;
    }
    std::vector<double> table;
    for (size_t a = 0; a < n; ++a)
        for (size_t b = a + 1; open[a] && b < n; ++b)
            if (open[b] && root(parent, a) != root(parent, b) && dependence(d, a, b, table) > model.dependence)
                parent[root(parent, b)] = root(parent, a);
    for (size_t g = 0; g < n; ++g) {
        if (root(parent, g) != g) continue;
        std::vector<size_t> members;
        for (size_t i = 0; i < n; ++i)
            if (root(parent, i) == g) members.push_back(i);
        Draft part;
        part.weight = d.weight;
        for (size_t h = 0; h < d.size(); ++h)
            for (size_t i : members) part.choice.push_back(d.row(h)[i]);
        for (size_t i : members) part.tracks.push_back(std::move(d.tracks[i]));
        parts.push_back(std::move(part));
    }
    return parts;
}

}  // namespace trackfield
