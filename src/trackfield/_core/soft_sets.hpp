// The cheapest set of at most three sensors that leaves little enough uncertainty, exactly; what it
// leaves may have a worth of its own: cost = price + worth * trace. Sets are tried by rising price, so
// that a branch ends where it cannot be cheaper any more.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

namespace trackfield::soft {

constexpr double kNone = std::numeric_limits<double>::infinity();

// Symmetric matrix in 2 or 3 dimensions, lower triangle by rows.
template <int D>
struct Symmetric {
    static constexpr int kSize = D * (D + 1) / 2;
    double v[kSize];

    static Symmetric lower_of(const double *full) {
        Symmetric s;
        for (int i = 0, k = 0; i < D; ++i)
            for (int j = 0; j <= i; ++j) s.v[k++] = full[i * D + j];
        return s;
    }

    static Symmetric square_of(const double *g) {
        Symmetric s;
        for (int i = 0, k = 0; i < D; ++i)
            for (int j = 0; j <= i; ++j) s.v[k++] = g[i] * g[j];
        return s;
    }

    Symmetric operator+(const Symmetric &other) const {
        Symmetric s;
        for (int k = 0; k < kSize; ++k) s.v[k] = v[k] + other.v[k];
        return s;
    }

    // Trace of the inverse: sum of the principal minors over the determinant; infinite if singular.
    double inverse_trace() const {
        if constexpr (D == 2) {
            const double sum = v[0] + v[2], det = v[0] * v[2] - v[1] * v[1];
            return det > 1e-14 * sum * sum ? sum / det : kNone;
        } else {
            const double a = v[2] * v[5] - v[4] * v[4], b = v[0] * v[5] - v[3] * v[3], c = v[0] * v[2] - v[1] * v[1];
            const double det = v[0] * a - v[1] * (v[1] * v[5] - v[4] * v[3]) + v[3] * (v[1] * v[4] - v[2] * v[3]);
            const double sum = v[0] + v[2] + v[5];
            return det > 1e-14 * sum * sum * sum ? (a + b + c) / det : kNone;
        }
    }
};

struct Set {
    int32_t sensor[3] = {-1, -1, -1};
    double price = kNone;
    double cost = kNone;
    double trace = kNone;
};

template <int D>
class Search {
    using Info = Symmetric<D>;

  public:
    Search(double bound, double worth) : bound_(bound), worth_(worth) {}

    // Prior information (D, D), gains (n, D), prices (n,) where an infinite one is never paid.
    Set best(const double *prior, const double *gains, const double *prices, int n, int fewest, int most) {
        order_.clear();
        for (int i = 0; i < n; ++i)
            if (std::isfinite(prices[i])) order_.push_back(i);
        std::sort(order_.begin(), order_.end(), [&](int a, int b) { return prices[a] != prices[b] ? prices[a] < prices[b] : a < b; });
        price_.clear(), info_.clear();
        for (int i : order_) {
            price_.push_back(prices[i]);
            info_.push_back(Info::square_of(gains + size_t(i) * D));
        }
        cheapest_ = sharpest_ = Set{};
        const Info start = Info::lower_of(prior);
        if (fewest <= 0) see(start, 0.0, -1, -1, -1);
        if (fewest <= 1 && most >= 1) singles(start);
        if (fewest <= 2 && most >= 2) pairs(start);
        if (most >= 3) triples(start);
        return cheapest_.cost < kNone ? cheapest_ : sharpest_;
    }

  private:
    double bound_, worth_;
    std::vector<int> order_;
    std::vector<double> price_;
    std::vector<Info> info_;
    Set cheapest_, sharpest_;

    int count() const { return int(price_.size()); }

    bool open(double price) const { return price <= cheapest_.cost; }

    // Equal costs: the sharper set. None is good enough: the sharpest, and of those the cheapest.
    void see(const Info &information, double price, int i, int j, int k) {
        const double trace = information.inverse_trace();
        if (trace == kNone) return;
        if (trace <= bound_) {
            const double cost = price + worth_ * trace;
            if (cost < cheapest_.cost || (cost == cheapest_.cost && trace < cheapest_.trace)) keep(cheapest_, price, trace, i, j, k);
        } else if (trace < sharpest_.trace || (trace == sharpest_.trace && price < sharpest_.price)) {
            keep(sharpest_, price, trace, i, j, k);
        }
    }

    void keep(Set &set, double price, double trace, int i, int j, int k) {
        const int place[3] = {i, j, k};
        for (int m = 0; m < 3; ++m) set.sensor[m] = place[m] < 0 ? -1 : order_[place[m]];
        set.price = price, set.trace = trace, set.cost = price + worth_ * trace;
    }

    void singles(const Info &start) {
        for (int i = 0; i < count() && open(price_[i]); ++i) see(start + info_[i], price_[i], i, -1, -1);
    }

    void pairs(const Info &start) {
        for (int i = 0; i + 1 < count() && open(price_[i] + price_[i + 1]); ++i) {
            const Info one = start + info_[i];
            for (int j = i + 1; j < count() && open(price_[i] + price_[j]); ++j) see(one + info_[j], price_[i] + price_[j], i, j, -1);
        }
    }

    void triples(const Info &start) {
        for (int i = 0; i + 2 < count() && open(price_[i] + price_[i + 1] + price_[i + 2]); ++i) {
            const Info one = start + info_[i];
            for (int j = i + 1; j + 1 < count() && open(price_[i] + price_[j] + price_[j + 1]); ++j) {
                const Info two = one + info_[j];
                const double paid = price_[i] + price_[j];
                for (int k = j + 1; k < count() && open(paid + price_[k]); ++k) see(two + info_[k], paid + price_[k], i, j, k);
            }
        }
    }
};

}  // namespace trackfield::soft
