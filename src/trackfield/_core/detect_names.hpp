// Who is who in a joint hypothesis. After a meeting two members may have changed places in some
// particles; under any naming the same is believed of the targets, and names follow the majority.
#pragma once

#include <algorithm>
#include <array>
#include <numeric>

#include "detect_belief.hpp"

namespace trackfield::detect {

constexpr int kMostNamed = 4;
using Naming = std::array<int8_t, kMostNamed>;
using Anchor = std::array<double, 4>;

struct Names {
    std::vector<int> members;     // of the group, that can change places
    std::vector<Naming> namings;  // all of them, the identity first
    std::vector<uint8_t> of;      // the naming of each particle
};

// Gather what anchor a collects under each particle's nearest naming; the weight of each naming.
inline std::vector<double> assign(const Group &g, Names &names, const std::vector<Anchor> &anchors, double horizon, std::vector<Anchor> &means) {
    const int k = int(names.members.size());
    std::vector<double> share(names.namings.size(), 0.0), weight(k, 0.0);
    means.assign(k, Anchor{});
    for (size_t j = 0; j < g.weight.size(); ++j) {
        bool all = true;
        Anchor at[kMostNamed];
        for (int l = 0; l < k; ++l) {
            const Cloud &c = g.members[names.members[l]].cloud;
            all = all && c.here[j];
            at[l] = {c.x[j], c.y[j], c.vx[j], c.vy[j]};
        }
        names.of[j] = 0;
        if (!all) continue;
        double d2[kMostNamed][kMostNamed], least = 1e300;
        for (int a = 0; a < k; ++a)
            for (int l = 0; l < k; ++l) {
                const double dx = at[l][0] - anchors[a][0], dy = at[l][1] - anchors[a][1];
                const double ux = horizon * (at[l][2] - anchors[a][2]), uy = horizon * (at[l][3] - anchors[a][3]);
                d2[a][l] = dx * dx + dy * dy + ux * ux + uy * uy;
            }
        for (size_t p = 0; p < names.namings.size(); ++p) {
            double sum = 0;
            for (int a = 0; a < k; ++a) sum += d2[a][names.namings[p][a]];
            if (sum < least) least = sum, names.of[j] = uint8_t(p);
        }
        const Naming &naming = names.namings[names.of[j]];
        share[names.of[j]] += g.weight[j];
        for (int a = 0; a < k; ++a) {
            weight[a] += g.weight[j];
            for (int d = 0; d < 4; ++d) means[a][d] += g.weight[j] * at[naming[a]][d];
        }
    }
    for (int a = 0; a < k; ++a)
        for (int d = 0; d < 4; ++d) means[a][d] = weight[a] > 0 ? means[a][d] / weight[a] : anchors[a][d];
    return share;
}

// Each particle's naming nearest to the anchors (position, and velocity over `horizon` seconds).
// Anchors begin at the members' means and exchange names where most particles say so.
inline Names names_of(const Group &g, double mature, double horizon) {
    Names names;
    std::vector<Anchor> anchors, means;
    for (int m = 0; m < int(g.members.size()); ++m) {
        const Member &o = g.members[m];
        if (o.existence < mature || int(names.members.size()) == kMostNamed) continue;
        names.members.push_back(m);
        anchors.push_back({o.mean[0], o.mean[1], o.mean[2], o.mean[3]});
    }
    const int k = int(names.members.size());
    if (k < 2) return {};
    Naming naming{0, 1, 2, 3};
    do names.namings.push_back(naming);
    while (std::next_permutation(naming.begin(), naming.begin() + k));
    names.of.assign(g.weight.size(), 0);
    for (int round = 0; round < 4; ++round) {
        const std::vector<double> share = assign(g, names, anchors, horizon, means);
        const size_t most = std::max_element(share.begin(), share.end()) - share.begin();
        for (int a = 0; a < k; ++a) anchors[names.namings[most][a]] = means[a];
        if (round > 0 && most == 0) break;
    }
    return names;
}

// The cloud of the a-th named member under every particle's own naming.
inline Cloud named(const Group &g, const Names &names, int a) {
    Cloud c = g.members[names.members[a]].cloud;
    for (size_t j = 0; j < c.size(); ++j)
        if (names.of[j]) c.set(j, g.members[names.members[names.namings[names.of[j]][a]]].cloud, j);
    return c;
}

inline void rename(Group &g, const Names &names) {
    std::vector<Cloud> clouds;
    for (size_t a = 0; a < names.members.size(); ++a) clouds.push_back(named(g, names, int(a)));
    for (size_t a = 0; a < clouds.size(); ++a) g.members[names.members[a]].cloud = std::move(clouds[a]);
}

}  // namespace trackfield::detect
