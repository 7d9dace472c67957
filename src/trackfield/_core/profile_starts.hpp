// Where to start the fit of a profile: a grid of times and widths, the amplitude fitted at each.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "amplitude_sample.hpp"
#include "profile_shape.hpp"

namespace trackfield::profiles {

constexpr size_t kBins = 128;        // samples are averaged to at most so many
constexpr size_t kFadingBins = 24;   // with fading, where one sample says little
constexpr double kRatio = 1.7;       // from a width of the grid to the next
constexpr double kSpacing = 0.7;     // from a time of the grid to the next, in widths
constexpr double kFadingRatio = 2.0, kFadingSpacing = 1.0;
constexpr int kReweighted = 2;       // steps by which the amplitude is fitted under fading
constexpr double kRival = 8.0;       // a second start may be so much less likely than the first [nats]

struct Limits {
    double earliest = 0, latest = 0, narrowest = 0, widest = 0;  // of tm and D [s]
};

// Samples averaged in time: mean time, mean value, mean square, number of samples.
struct Bins {
    std::vector<double> t, value, square, count;

    Bins(const double *times, size_t n, size_t most) {
        const size_t each = (n + most - 1) / most;
        for (size_t i = 0; i < n; i += each) {
            const size_t end = std::min(i + each, n);
            double sum = 0;
            for (size_t j = i; j < end; ++j) sum += times[j];
            t.push_back(sum / double(end - i));
            count.push_back(double(end - i));
        }
        size_ = each;
        value.resize(t.size()), square.resize(t.size());
    }

    void fill(const double *r, size_t n) {
        for (size_t b = 0; b < t.size(); ++b) {
            double sum = 0, squares = 0;
            for (size_t j = b * size_; j < std::min((b + 1) * size_, n); ++j) sum += r[j], squares += r[j] * r[j];
            value[b] = sum / count[b], square[b] = squares / count[b];
        }
    }

   private:
    size_t size_ = 1;
};

class Grid {
   public:
    Grid(const double *times, size_t n, const Shape &shape, const Limits &limits, bool rayleigh)
        : bins(times, n, rayleigh ? kFadingBins : kBins), rayleigh_(rayleigh) {
        const double span = limits.latest - limits.earliest;
        const double step = n > 1 ? (times[n - 1] - times[0]) / double(bins.t.size()) : limits.narrowest;
        const double ratio = rayleigh ? kFadingRatio : kRatio, spacing = rayleigh ? kFadingSpacing : kSpacing;
        for (double width = std::clamp(0.5 * step, limits.narrowest, limits.widest); width <= limits.widest; width *= ratio) {
            const double apart = std::max(spacing * width, 0.5 * step);
            const int count = std::max(3, 1 + int(span / apart));
            for (int k = 0; k < count; ++k) add(shape, limits.earliest + span * (k + 0.5) / count, width);
        }
        gain_.resize(tm_.size()), a_.resize(tm_.size());
    }

    // The likeliest start, and a second of another time or width if it is nearly as likely.
    std::vector<Numbers> starts(const double *r, size_t n, const Noise &noise) {
        bins.fill(r, n);
        for (size_t k = 0; k < tm_.size(); ++k) rayleigh_ ? fade(k, noise) : match(k, noise);
        const size_t first = size_t(std::max_element(gain_.begin(), gain_.end()) - gain_.begin());
        size_t second = first;
        for (size_t k = 0; k < tm_.size(); ++k) {
            const bool apart = std::abs(tm_[k] - tm_[first]) > std::max(width_[k], width_[first]);
            if (apart && (second == first || gain_[k] > gain_[second])) second = k;
        }
        std::vector<Numbers> out{numbers(first, noise)};
        if (second != first && gain_[second] > gain_[first] - kRival) out.push_back(numbers(second, noise));
        return out;
    }

   private:
    Bins bins;
    bool rayleigh_;
    std::vector<double> tm_, width_, energy_, template_;  // template: (grid, bins), squared under fading
    std::vector<double> gain_, a_;

    Numbers numbers(size_t k, const Noise &noise) const {
        return {std::max(a_[k], 0.3 * noise.sigma), tm_[k], width_[k]};
    }

    void add(const Shape &shape, double tm, double width) {
        tm_.push_back(tm), width_.push_back(width);
        double energy = 0;
        for (size_t b = 0; b < bins.t.size(); ++b) {
            const double g = shape.at((bins.t[b] - tm) / width);
            template_.push_back(rayleigh_ ? g * g : g);
            energy += bins.count[b] * g * g;
        }
        energy_.push_back(energy);
    }

    // Without fading the best amplitude is the projection on the template.
    void match(size_t k, const Noise &noise) {
        const double *g = template_.data() + k * bins.t.size();
        double product = 0;
        for (size_t b = 0; b < bins.t.size(); ++b) product += bins.count[b] * g[b] * bins.value[b];
        product = std::max(product, 0.0);
        a_[k] = product / energy_[k];
        gain_[k] = 0.5 * product * a_[k] / (noise.sigma * noise.sigma);
    }

    // Under fading the mean energy N0 + s h is linear in s = A^2: reweighted least squares.
    void fade(size_t k, const Noise &noise) {
        const double n0 = noise.sigma * noise.sigma, *h = template_.data() + k * bins.t.size();
        const double top = std::isinf(noise.saturation) ? INFINITY : noise.saturation * noise.saturation;
        double s = n0;
        for (int round = 0; round <= kReweighted; ++round) {
            double up = 0, down = 1e-300;
            for (size_t b = 0; b < bins.t.size(); ++b) {
                const double v = round ? n0 + s * h[b] : n0 + std::min(bins.square[b], top);
                const double w = bins.count[b] * h[b] / (v * v);
                up += w * (bins.square[b] - n0), down += w * h[b];
            }
            s = std::max(up / down, 1e-2 * n0);
        }
        double cost = 0;
        LogSum logs;  // of equal bins, but for the last one, which is no worse than a little too heavy
        for (size_t b = 0; b < bins.t.size(); ++b) {
            const double x = 1.0 + s * h[b] / n0;
            cost += bins.count[b] * bins.square[b] / (n0 * x);
            logs.add(x);
        }
        a_[k] = std::sqrt(s), gain_[k] = -cost - bins.count[0] * logs.total();
    }
};

// The paper's coarse start: the largest sample, and the sample nearest to half of it.
inline Numbers coarse(const double *t, const double *r, size_t n, const Limits &limits, double floor) {
    const size_t top = size_t(std::max_element(r, r + n) - r);
    double width = 0, best = INFINITY;
    for (size_t i = 0; i < n; ++i) {
        const double off = std::abs(r[i] - 0.5 * r[top]);
        if (i != top && off < best) best = off, width = std::abs(t[i] - t[top]);
    }
    return {std::max(r[top], floor), t[top], std::clamp(width, limits.narrowest, limits.widest)};
}

}  // namespace trackfield::profiles
