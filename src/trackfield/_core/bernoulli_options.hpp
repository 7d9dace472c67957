// What each history may have met in a scan: nothing, or one of the reports in its gate.
#pragma once

#include <limits>

#include "bernoulli_frame.hpp"

namespace trackfield {

struct BernoulliReport {
    double x = 0, y = 0;
    Sym2 R;
    int32_t number = 0;
    bool own_noise = false;   // brought its covariance
    double p_detection = 0;   // here and now
    double rho = 0;           // density of reports of no known target: false ones and first ones
    double first = 0;         // probability that such a report is of a target
};

// Reports by square cells, so that a gate looks at near ones only.
class ReportGrid {
  public:
    explicit ReportGrid(const std::vector<BernoulliReport> &reports) : reports_(reports) {
        if (reports.empty()) return;
        double x1 = reports[0].x, y1 = reports[0].y;
        x0_ = x1;
        y0_ = y1;
        for (const BernoulliReport &z : reports) {
            x0_ = std::min(x0_, z.x);
            x1 = std::max(x1, z.x);
            y0_ = std::min(y0_, z.y);
            y1 = std::max(y1, z.y);
        }
        const double n = double(reports.size());
        cell_ = std::max({std::sqrt((x1 - x0_) * (y1 - y0_) / n), (x1 - x0_) / n, (y1 - y0_) / n, 1e-9});
        columns_ = int((x1 - x0_) / cell_) + 1;
        rows_ = int((y1 - y0_) / cell_) + 1;
        begin_.assign(size_t(rows_) * columns_ + 1, 0);
        for (const BernoulliReport &z : reports) ++begin_[cell(z) + 1];
        for (size_t i = 1; i < begin_.size(); ++i) begin_[i] += begin_[i - 1];
        order_.resize(reports.size());
        std::vector<int32_t> at(begin_.begin(), begin_.end() - 1);
        for (size_t j = 0; j < reports.size(); ++j) order_[at[cell(reports[j])]++] = int32_t(j);
    }

    // Calls visit(j) for every report within (dx, dy) of a place, and some more.
    template <class Visit> void near(double x, double y, double dx, double dy, Visit visit) const {
        if (order_.empty()) return;
        const int i0 = clamp((y - dy - y0_) / cell_, rows_), i1 = clamp((y + dy - y0_) / cell_, rows_);
        const int j0 = clamp((x - dx - x0_) / cell_, columns_), j1 = clamp((x + dx - x0_) / cell_, columns_);
        for (int i = i0; i <= i1; ++i)
            for (int k = begin_[size_t(i) * columns_ + j0]; k < begin_[size_t(i) * columns_ + j1 + 1]; ++k) visit(order_[k]);
    }

  private:
    const std::vector<BernoulliReport> &reports_;
    double x0_ = 0, y0_ = 0, cell_ = 1;
    int rows_ = 0, columns_ = 0;
    std::vector<int32_t> begin_, order_;

    static int clamp(double v, int n) { return v < 0 ? 0 : v >= n ? n - 1 : int(v); }
    size_t cell(const BernoulliReport &z) const {
        return size_t(clamp((z.y - y0_) / cell_, rows_)) * columns_ + clamp((z.x - x0_) / cell_, columns_);
    }
};

struct Option {
    double log_weight = 0;
    int32_t report = -1;
};

// Options of all leaves, each leaf's likeliest first.
struct Options {
    std::vector<int32_t> begin{0};
    std::vector<Option> options;
    std::vector<double> p_detection;  // of each leaf

    int32_t count(int32_t leaf) const { return begin[leaf + 1] - begin[leaf]; }
    int32_t missed(int32_t leaf) const {
        int32_t k = begin[leaf];
        while (options[k].report >= 0) ++k;
        return k;
    }
};

// Weights (1 - r p) of a miss and r p N(z; H x, S)/rho of a detection, r the predicted existence.
inline Options weigh(const std::vector<Leaf> &leaves, const std::vector<BernoulliReport> &reports,
                     const BernoulliModel &model, double p_factor, double p_learned, int age) {
    Options found;
    found.begin.reserve(leaves.size() + 1);
    found.p_detection.reserve(leaves.size());
    const ReportGrid grid(reports);
    double widest_x = 0, widest_y = 0;
    for (const BernoulliReport &z : reports) {
        widest_x = std::max(widest_x, z.R.xx);
        widest_y = std::max(widest_y, z.R.yy);
    }
    const size_t ages = model.p_detection.size();
    const Map *map = ages ? &model.p_detection[std::min(size_t(age), ages - 1)] : nullptr;
    for (const Leaf &leaf : leaves) {
        const Plane &s = leaf.state;
        const double p = p_factor * (map ? map->at(s.x, s.y) : p_learned), r = leaf.existence;
        found.p_detection.push_back(p);
        const size_t first = found.options.size();
        found.options.push_back({std::log(std::max(1 - r * p, 1e-300)), -1});
        if (r * p > 1e-9)
            grid.near(s.x, s.y, std::sqrt(model.gate * (s.A.xx + widest_x)), std::sqrt(model.gate * (s.A.yy + widest_y)),
                      [&](int32_t j) {
                          const BernoulliReport &z = reports[j];
                          const Sym2 S = s.A + z.R;
                          const double det = S.det(), ex = z.x - s.x, ey = z.y - s.y;
                          const double d2 = (S.yy * ex * ex - 2 * S.xy * ex * ey + S.xx * ey * ey) / det;
                          if (d2 > model.gate) return;
                          const double density = 6.283185307179586 * std::sqrt(det) * z.rho;
                          found.options.push_back({std::log(r * p / density) - d2 / 2, j});
                      });
        std::sort(found.options.begin() + first, found.options.end(), [](const Option &a, const Option &b) {
            return a.log_weight != b.log_weight ? a.log_weight > b.log_weight : a.report < b.report;
        });
        found.begin.push_back(int32_t(found.options.size()));
    }
    return found;
}

}  // namespace trackfield
