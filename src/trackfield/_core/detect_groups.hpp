// Which members are joint: those that share sensors, as far as a group may grow.
#pragma once

#include "detect_names.hpp"
#include "detect_particles.hpp"

namespace trackfield::detect {

struct Place {
    int group, member;
};

struct Link {
    double shared;
    int a, b;
};

class Grouping {
   public:
    Grouping(const Settings &settings, size_t sensors) : s(settings), mine_(sensors, 0.0) {}

    // Members whose coverage of some sensor is shared: max_i min(c_ia, c_ib). Two that have only
    // begun are left apart, and a group holds one such member at most: its particles are drawn in
    // two strata, with and without it.
    void apply(Belief &b) {
        places_.clear();
        for (int g = 0; g < int(b.groups.size()); ++g)
            for (int m = 0; m < int(b.groups[g].members.size()); ++m) places_.push_back({g, m});
        const std::vector<int> root = roots(b);
        const int n = int(places_.size());
        for (int g = 0; g < int(b.groups.size()); ++g) {
            int first = -1;
            bool parted = false;
            for (int k = 0; k < n; ++k) {
                if (places_[k].group != g) continue;
                parted = parted || (first >= 0 && root[k] != first);
                first = root[k];
            }
            if (parted) rename(b.groups[g], names_of(b.groups[g], s.mature, s.name_horizon));
        }
        std::vector<Group> next;
        for (int k = 0; k < n; ++k) {
            if (root[k] != k) continue;
            std::vector<int> own;
            for (int l = k; l < n; ++l)
                if (root[l] == k) own.push_back(l);
            next.push_back(assemble(b, own));
        }
        b.groups = std::move(next);
    }

   private:
    const Settings &s;
    std::vector<double> mine_;
    std::vector<Place> places_;

    const Member &member(const Belief &b, int k) const { return b.groups[places_[k].group].members[places_[k].member]; }

    std::vector<Link> links(const Belief &b) {
        std::vector<Link> found;
        const int n = int(places_.size());
        for (int k = 0; k < n; ++k) {
            const Member &a = member(b, k);
            for (const Seen &e : a.cover) mine_[e.sensor] = e.covered;
            for (int l = k + 1; l < n; ++l) {
                const Member &o = member(b, l);
                if (a.existence < s.mature && o.existence < s.mature) continue;
                double shared = 0;
                for (const Seen &e : o.cover) shared = std::max(shared, std::min(e.covered, mine_[e.sensor]));
                if (shared > (places_[k].group == places_[l].group ? s.part : s.join)) found.push_back({shared, k, l});
            }
            for (const Seen &e : a.cover) mine_[e.sensor] = 0;
        }
        std::sort(found.begin(), found.end(), [](const Link &x, const Link &y) {
            if (x.shared != y.shared) return x.shared > y.shared;
            return x.a != y.a ? x.a < y.a : x.b < y.b;
        });
        return found;
    }

    std::vector<int> roots(const Belief &b) {
        const int n = int(places_.size());
        std::vector<int> root(n), size(n, 1), young(n);
        std::iota(root.begin(), root.end(), 0);
        for (int k = 0; k < n; ++k) young[k] = member(b, k).existence < s.mature;
        auto find = [&](int k) {
            while (root[k] != k) k = root[k];
            return k;
        };
        for (const Link &l : links(b)) {
            const int x = std::min(find(l.a), find(l.b)), y = std::max(find(l.a), find(l.b));
            if (x == y || size[x] + size[y] > s.group_size || young[x] + young[y] > 1) continue;
            root[y] = x;
            size[x] += size[y];
            young[x] += young[y];
        }
        for (int k = 0; k < n; ++k) root[k] = find(k);
        return root;
    }

    Group assemble(Belief &b, const std::vector<int> &own) {
        Group g;
        std::vector<int> parts;
        for (int k : own)
            if (std::find(parts.begin(), parts.end(), places_[k].group) == parts.end()) parts.push_back(places_[k].group);
        for (int part : parts) {
            Group piece;
            piece.weight = b.groups[part].weight;
            for (int k : own)
                if (places_[k].group == part) piece.members.push_back(member(b, k));
            if (b.groups[part].joint() && own.size() == 1) {
                piece.members[0].cloud = marginal(b.chance, b.groups[part], piece.members[0]);
                piece.weight.assign(piece.weight.size(), 1.0 / piece.weight.size());
            }
            if (!b.groups[part].joint() && own.size() > 1) flag(b.chance, piece);
            if (g.members.empty()) g = std::move(piece);
            else adjoin(b.chance, g, std::move(piece));
        }
        if (g.joint()) {
            normalize(g.weight);
            count_existence(g);
        }
        return g;
    }

    // From an existence beside the particles to one inside: at least half of them have the target.
    void flag(Chance &chance, Group &g) const {
        Member &m = g.members[0];
        const int n = int(g.weight.size());
        const double r = m.existence;
        const int with = r >= 1 ? n : int(std::lround(n * std::max(r, 0.5)));
        const std::vector<int> order = shuffled(chance, n);
        double sum = 0;
        for (int k = 0; k < with; ++k) sum += g.weight[order[k]];
        for (int k = 0; k < n; ++k) {
            const int j = order[k];
            m.cloud.here[j] = k < with;
            g.weight[j] = k < with ? g.weight[j] * r / sum : (1 - r) / (n - with);
        }
    }

    // Independent particles meet in a random order.
    void adjoin(Chance &chance, Group &g, Group piece) const {
        const std::vector<int> order = shuffled(chance, int(g.weight.size()));
        gather(piece.weight, order);
        for (size_t j = 0; j < order.size(); ++j) g.weight[j] *= piece.weight[j];
        for (Member &m : piece.members) {
            gather(m.cloud, order);
            g.members.push_back(std::move(m));
        }
        normalize(g.weight);
    }
};

}  // namespace trackfield::detect
