// Sets of k of the sensors that see a target: which are accurate enough, which of those is cheapest.
// A set is good enough if the trace of (prior + sum g g')^-1 over its gains g is at most a bound.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

namespace trackfield::sets {

constexpr double kNone = std::numeric_limits<double>::infinity();

// Symmetric information of a position in D dimensions: xx, xy, yy(, xz, yz, zz).
template <int D>
struct Information {
    static constexpr int kSize = D * (D + 1) / 2;
    double v[kSize] = {};

    static Information of(const double *g) {
        Information o;
        for (int i = 0, k = 0; i < D; ++i)
            for (int j = 0; j <= i; ++j) o.v[k++] = g[i] * g[j];
        return o;
    }

    static Information matrix(const double *m) {
        Information o;
        for (int i = 0, k = 0; i < D; ++i)
            for (int j = 0; j <= i; ++j) o.v[k++] = m[i * D + j];
        return o;
    }

    Information operator+(const Information &b) const {
        Information o;
        for (int k = 0; k < kSize; ++k) o.v[k] = v[k] + b.v[k];
        return o;
    }

    // Trace of the inverse; infinite where a direction has no information.
    double trace() const {
        if constexpr (D == 2) {
            const double sum = v[0] + v[2], det = v[0] * v[2] - v[1] * v[1];
            return det > 1e-12 * sum * sum ? sum / det : kNone;
        } else {
            const double yz = v[2] * v[5] - v[4] * v[4], xz = v[0] * v[5] - v[3] * v[3], xy = v[0] * v[2] - v[1] * v[1];
            const double det = v[0] * yz - v[1] * (v[1] * v[5] - v[4] * v[3]) + v[3] * (v[1] * v[4] - v[2] * v[3]);
            const double sum = v[0] + v[2] + v[5];
            return det > 1e-14 * sum * sum * sum ? (yz + xz + xy) / det : kNone;
        }
    }
};

template <int K>
struct Chosen {
    int place[K] = {};  // among the candidates, by rising price
    double value = kNone;
};

// The candidates of one interval, by rising price (ties in their own order). K sensors a set.
template <int D, int K>
class Search {
   public:
    Search(const Information<D> &prior, double bound) : prior_(prior), bound_(bound) {}

    // Candidates without a finite price are left out.
    void load(const int32_t *node, const double *gains, int n, const double *price) {
        order_.clear();
        for (int i = 0; i < n; ++i)
            if (std::isfinite(price[node[i]])) order_.push_back(i);
        std::stable_sort(order_.begin(), order_.end(), [&](int a, int b) { return price[node[a]] < price[node[b]]; });
        const int m = int(order_.size());
        price_.resize(m);
        gain_.resize(m);
        for (int i = 0; i < m; ++i) {
            price_[i] = price[node[order_[i]]];
            gain_[i] = Information<D>::of(gains + size_t(order_[i]) * D);
        }
        rest_.assign(m + 1, Information<D>{});
        for (int i = m; i-- > 0;) rest_[i] = rest_[i + 1] + gain_[i];
    }

    // Least sum of prices among the sets within the bound; the first such set by price order.
    Chosen<K> cheapest() {
        best_ = {};
        buy<K>(prior_, 0, 0.0);
        return named();
    }

    // Least trace of all sets, bound or not.
    Chosen<K> sharpest() {
        best_ = {};
        sharpen<K>(prior_, 0);
        return named();
    }

    // How many sets are within the bound; `each` counts those that hold a candidate.
    double count(std::vector<double> &each) { return tally<K>(prior_, 0, each); }

   private:
    // Fill the set's last R places from candidates `from` on.
    template <int R>
    void buy(const Information<D> &J, int from, double cost) {
        for (int i = from; i + R <= int(order_.size()); ++i) {
            double least = cost;  // the cheapest way to fill the set from here on
            for (int j = i; j < i + R; ++j) least += price_[j];
            if (least >= best_.value) return;
            if ((J + rest_[i]).trace() > bound_) return;  // not even all of the rest together
            const Information<D> with = J + gain_[i];
            at_[K - R] = i;
            if constexpr (R > 1)
                buy<R - 1>(with, i + 1, cost + price_[i]);
            else if (with.trace() <= bound_)
                keep(cost + price_[i]);
        }
    }

    template <int R>
    void sharpen(const Information<D> &J, int from) {
        for (int i = from; i + R <= int(order_.size()); ++i) {
            if ((J + rest_[i]).trace() >= best_.value) return;
            const Information<D> with = J + gain_[i];
            at_[K - R] = i;
            if constexpr (R > 1)
                sharpen<R - 1>(with, i + 1);
            else if (const double trace = with.trace(); trace < best_.value)
                keep(trace);
        }
    }

    template <int R>
    double tally(const Information<D> &J, int from, std::vector<double> &each) {
        double all = 0.0;
        for (int i = from; i + R <= int(order_.size()); ++i) {
            const Information<D> with = J + gain_[i];
            double found;
            if constexpr (R > 1)
                found = tally<R - 1>(with, i + 1, each);
            else
                found = double(with.trace() <= bound_);
            each[order_[i]] += found;
            all += found;
        }
        return all;
    }

    void keep(double value) {
        std::copy(at_, at_ + K, best_.place);
        best_.value = value;
    }

    Chosen<K> named() const {
        Chosen<K> o = best_;
        if (o.value < kNone)
            for (int j = 0; j < K; ++j) o.place[j] = order_[o.place[j]];
        return o;
    }

    Information<D> prior_;
    double bound_;
    std::vector<int> order_;
    std::vector<double> price_;
    std::vector<Information<D>> gain_, rest_;
    int at_[K] = {};
    Chosen<K> best_;
};

}  // namespace trackfield::sets
