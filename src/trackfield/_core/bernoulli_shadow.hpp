// How the density of false reports depends on the distance to the nearest likely target: learned on line.
#pragma once

#include "bernoulli_frame.hpp"

namespace trackfield {

// Fusion of many sensors takes what is left near a target for a part of it: false reports are rarer
// there, and the denser elsewhere. Rings of doubling width around the nearest likely target.
class Shadow {
  public:
    Shadow(const BernoulliModel &m, const std::vector<Leaf> &leaves) : m_(m), scale_(std::sqrt(m.region.area()) / 64) {
        for (const Leaf &leaf : leaves)
            if (leaf.weight * leaf.existence > 0.5) likely_.push_back({leaf.state.x, leaf.state.y});
        for (int i = 0; i < kGrid; ++i)
            for (int j = 0; j < kGrid; ++j)
                share_[ring(m.region.x_min + (j + 0.5) / kGrid * (m.region.x_max - m.region.x_min),
                            m.region.y_min + (i + 0.5) / kGrid * (m.region.y_max - m.region.y_min))] += 1.0 / (kGrid * kGrid);
    }

    int ring(double x, double y) const {
        double least = 1e300;
        for (auto [px, py] : likely_) least = std::min(least, (x - px) * (x - px) + (y - py) * (y - py));
        int r = 0;
        for (double edge = scale_; r < kRings - 1 && least > edge * edge; edge *= 2) ++r;
        return r;
    }

    double share(int ring) const { return share_[ring]; }

    // Densities of the rings over the mean over the region.
    std::array<double, kRings> relative(const std::array<Learned, kRings> &learned) const {
        std::array<double, kRings> density;
        double mean = 0;
        for (int r = 0; r < kRings; ++r) mean += share_[r] * (density[r] = learned[r].mean());
        for (double &d : density) d /= std::max(mean, 1e-9);
        return density;
    }

  private:
    static constexpr int kGrid = 16;
    const BernoulliModel &m_;
    const double scale_;
    std::vector<std::pair<double, double>> likely_;
    std::array<double, kRings> share_{};
};

}  // namespace trackfield
