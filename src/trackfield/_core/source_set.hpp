// The sources found so far, with an index of their places: who is near, what a sensor hears of them.
#pragma once

#include "source_fit.hpp"

namespace trackfield::signals {

struct Found {
    Source source;
    double cov[3] = {0, 0, 0};
    double gain = 0, misfit = 0;
    bool alive = true;
    bool good = false;   // the readings about it are as the fit expects
    bool whole = false;  // it was tried to be two
};

class SourceSet {
   public:
    std::vector<Found> found;

    SourceSet(const Field &field, double reach, int64_t &spent) : f(field), spent(spent), index(field, reach) {}

    // Sources near a place in order of distance, at most `most`, without `but`.
    std::vector<int32_t> neighbours(double x, double y, double radius, int most, int32_t but = -1) const {
        std::vector<std::pair<double, int32_t>> near;
        index.near(x, y, radius, [&](int32_t k) {
            const double r = std::hypot(found[k].source.x - x, found[k].source.y - y);
            if (k != but && r <= radius) near.push_back({r, k});
        });
        std::sort(near.begin(), near.end());
        std::vector<int32_t> ids;
        for (size_t k = 0; k < near.size() && int(k) < most; ++k) ids.push_back(near[k].second);
        return ids;
    }

    Signal heard(size_t i) {
        Signal sum;
        index.near(f.x(i), f.y(i), f.reach(i), [&](int32_t k) {
            ++spent;
            add(f, sum, signal_of(f, i, found[k].source));
        });
        return sum;
    }

    double excess(size_t i) {
        const Signal sum = heard(i);
        return residual_of(f, i, sum) / std::sqrt(variance_of(f, i, sum));
    }

    // Sources that a disc touches, or more, but for a group.
    std::vector<int32_t> others(double x, double y, double radius, const std::vector<int32_t> &group) const {
        std::vector<int32_t> ids;
        index.near(x, y, radius, [&](int32_t k) {
            if (std::find(group.begin(), group.end(), k) == group.end()) ids.push_back(k);
        });
        return ids;
    }

    std::vector<Source> of(const std::vector<int32_t> &group) const {
        std::vector<Source> o;
        for (int32_t k : group) o.push_back(found[k].source);
        return o;
    }

    void shift(int32_t k, const Source &to) {
        index.remove(k, found[k].source);
        found[k].source = to;
        index.insert(k, to);
    }

    void put(int32_t k, const Fit &fit, size_t place) {
        shift(k, fit.sources[place]);
        Found &one = found[k];
        std::copy_n(fit.covariance.begin() + 3 * place, 3, one.cov);
        one.misfit = fit.chi2 / double(std::max<size_t>(fit.n, 1));
        one.good = fit.good();
    }

    // The group as fitted; the fit's last source is new.
    void add_last(const Fit &fit, const std::vector<int32_t> &group, double gain) {
        for (size_t k = 0; k < group.size(); ++k) put(group[k], fit, k);
        const int32_t fresh = int32_t(found.size());
        found.push_back({fit.sources.back()});
        index.insert(fresh, fit.sources.back());
        put(fresh, fit, group.size());
        found[fresh].gain = gain;
    }

    void remove(int32_t k) {
        found[k].alive = false;
        index.remove(k, found[k].source);
    }

   private:
    const Field &f;
    int64_t &spent;
    SourceIndex index;
};

}  // namespace trackfield::signals
