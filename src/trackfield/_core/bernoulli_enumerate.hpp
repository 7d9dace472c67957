// The likeliest joint explanations of a scan, exactly: depth first with bounds, within a work budget.
#pragma once

#include "bernoulli_options.hpp"

namespace trackfield {

// Hypotheses about some tracks: log weights and leaves (hypotheses, tracks), -1 where there is no such target.
struct Joint {
    std::vector<int32_t> tracks;
    std::vector<double> log_weight;
    std::vector<int32_t> leaf;
    size_t size() const { return log_weight.size(); }
    const int32_t *row(size_t h) const { return leaf.data() + h * tracks.size(); }
};

// One way on: a hypothesis, and an option for each of its tracks (-1: no such target).
struct Explained {
    double log_weight = 0;
    int32_t hypothesis = 0;
    size_t at = 0;  // of its options in Enumeration::options
};

class Enumeration {
  public:
    std::vector<Explained> found;  // likeliest first
    std::vector<int32_t> options;
    int64_t work = 0;

    Enumeration(const Options &options, size_t reports, const BernoulliModel &model)
        : o_(options), taken_(reports, 0), keep_(size_t(model.hypotheses)), poor_(model.poor), log_least_(std::log(model.least_weight)) {}

    // False if the budget did not suffice; then nothing is found.
    bool run(const Joint &joint, int64_t budget) {
        const size_t H = joint.size();
        n_ = joint.tracks.size();
        budget_ = budget;
        best_ = -std::numeric_limits<double>::infinity();
        std::vector<std::pair<double, int32_t>> order(H);
        for (size_t h = 0; h < H; ++h) {
            double bound = joint.log_weight[h];
            for (size_t i = 0; i < n_; ++i)
                if (joint.row(h)[i] >= 0) bound += top(joint.row(h)[i]);
            order[h] = {bound, int32_t(h)};
        }
        std::sort(order.begin(), order.end(), [](auto &a, auto &b) { return a.first != b.first ? a.first > b.first : a.second < b.second; });
        choice_.resize(n_);
        rest_.resize(n_ + 1);
        for (auto [bound, h] : order) {
            if (bound < floor()) break;
            row_ = joint.row(h);
            rest_[n_] = 0;
            for (size_t i = n_; i-- > 0;) rest_[i] = rest_[i + 1] + (row_[i] >= 0 ? top(row_[i]) : 0);
            hypothesis_ = h;
            descend(0, joint.log_weight[h]);
            if (work > budget_) {
                found.clear();
                return false;
            }
        }
        trim();
        std::sort(found.begin(), found.end(), before);
        return !poor();
    }

  private:
    const Options &o_;
    std::vector<char> taken_;
    const size_t keep_;
    const double poor_, log_least_;
    double best_ = 0, worst_kept_ = -std::numeric_limits<double>::infinity();
    size_t n_ = 0;
    int64_t budget_ = 0;
    int32_t hypothesis_ = 0;
    const int32_t *row_ = nullptr;
    std::vector<int32_t> choice_;
    std::vector<double> rest_;

    // Whether what was left out may weigh as much as what was kept: the last ones kept are not much less
    // likely than the mean.
    bool poor() const {
        if (found.size() < keep_) return false;
        double total = 0;
        for (const Explained &e : found) total += std::exp(e.log_weight - found[0].log_weight);
        return std::exp(found.back().log_weight - found[0].log_weight) * double(keep_) > poor_ * total;
    }

    static bool before(const Explained &a, const Explained &b) {
        return a.log_weight != b.log_weight ? a.log_weight > b.log_weight : a.at < b.at;
    }
    double top(int32_t leaf) const { return o_.options[o_.begin[leaf]].log_weight; }
    double floor() const { return std::max(best_ + log_least_, worst_kept_); }

    void descend(size_t i, double log_weight) {
        if (++work > budget_) return;
        // A track with nothing in its gate has one way on.
        for (; i < n_; ++i) {
            if (row_[i] < 0) {
                choice_[i] = -1;
                continue;
            }
            if (o_.count(row_[i]) > 1) break;
            choice_[i] = o_.begin[row_[i]];
            log_weight += o_.options[choice_[i]].log_weight;
        }
        if (i == n_) {
            found.push_back({log_weight, hypothesis_, options.size()});
            options.insert(options.end(), choice_.begin(), choice_.end());
            best_ = std::max(best_, log_weight);
            if (found.size() >= 2 * keep_) trim();
            return;
        }
        for (int32_t k = o_.begin[row_[i]]; k < o_.begin[row_[i] + 1]; ++k) {
            const Option &option = o_.options[k];
            if (log_weight + option.log_weight + rest_[i + 1] < floor()) break;  // the others are less likely still
            if (option.report >= 0 && taken_[option.report]) continue;
            choice_[i] = k;
            if (option.report >= 0) taken_[option.report] = 1;
            descend(i + 1, log_weight + option.log_weight);
            if (option.report >= 0) taken_[option.report] = 0;
            if (work > budget_) return;
        }
    }

    // Keeps the likeliest; what is less likely than all of them need not be looked for any more.
    void trim() {
        const double least = best_ + log_least_;
        std::erase_if(found, [&](const Explained &e) { return e.log_weight < least; });
        if (found.size() <= keep_) return;
        std::nth_element(found.begin(), found.begin() + keep_ - 1, found.end(), before);
        found.resize(keep_);
        worst_kept_ = found.back().log_weight;
        std::vector<int32_t> kept(keep_ * n_);
        for (size_t k = 0; k < keep_; ++k) {
            std::copy_n(options.begin() + found[k].at, n_, kept.begin() + k * n_);
            found[k].at = k * n_;
        }
        options.swap(kept);
    }
};

}  // namespace trackfield
