// Sources of one scan: leaders speak, each is fitted with its neighbours, what brings too little goes.
#pragma once

#include <limits>

#include "source_fit.hpp"

namespace trackfield::signals {

struct Found {
    Source source;
    double cov[3] = {0, 0, 0};
    double gain = 0, misfit = 0;
    bool alive = true;
};

class Search {
   public:
    std::vector<Found> found;
    std::vector<int32_t> suspects;  // sensors that say much which no source explains
    int64_t spent = 0;

    Search(const Field &field, const Settings &settings)
        : f(field), s(settings), fitter(f, s, spent), sensors(f, cell_width(), f.n), sources(f, reach(), f.n) {
        for (size_t i = 0; i < f.n; ++i)
            if (f.spoke(i)) sensors.insert(int32_t(i), f.x(i), f.y(i));
        stamp.assign(f.n, 0);
        refused.assign(f.n, 0);
    }

    bool complete() const { return spent < s.work; }

    void run() {
        std::vector<int32_t> loud;
        for (size_t i = 0; i < f.n; ++i)
            if (f.spoke(i) && f.z[i] >= s.leader_sigmas * f.sigma[i]) loud.push_back(int32_t(i));
        for (int round = 0; round < s.rounds && complete(); ++round) {
            const auto [added, asked] = ask(loud, round == 0);
            if (added > 0) settle();
            if (asked == 0) break;
        }
        for (int32_t i : loud)
            if (refused[i] && excess(i) >= s.leader_sigmas) suspects.push_back(i);
    }

   private:
    struct Asked {
        int added, asked;
    };

    double reach() const {
        double most = 0;
        for (size_t i = 0; i < f.n; ++i) most = std::max(most, f.reach(i));
        return most;
    }
    double cell_width() const { return std::max(s.leader_radius, 0.5 * s.fit_radius); }

    // Sources near a place in order of distance, at most `most`, without `but`.
    std::vector<int32_t> neighbours(double x, double y, int most, int32_t but = -1) const {
        std::vector<std::pair<double, int32_t>> near;
        sources.near(x, y, s.group_radius, [&](int32_t k) {
            const double r = std::hypot(found[k].source.x - x, found[k].source.y - y);
            if (k != but && r <= s.group_radius) near.push_back({r, k});
        });
        std::sort(near.begin(), near.end());
        std::vector<int32_t> ids;
        for (size_t k = 0; k < near.size() && int(k) < most; ++k) ids.push_back(near[k].second);
        return ids;
    }

    Signal heard(size_t i, const std::vector<int32_t> &without) {
        Signal sum;
        sources.near(f.x(i), f.y(i), f.reach(i), [&](int32_t k) {
            ++spent;
            if (std::find(without.begin(), without.end(), k) == without.end())
                add(f, sum, signal_of(f, i, found[k].source));
        });
        return sum;
    }

    double excess(size_t i) {
        const Signal sum = heard(i, {});
        return residual_of(f, i, sum) / std::sqrt(variance_of(f, i, sum));
    }

    // Leaders in order: the loudest of their neighbourhood first, later those with the most excess.
    std::vector<int32_t> speakers(const std::vector<int32_t> &loud, bool first) {
        std::vector<std::pair<double, int32_t>> order;
        for (int32_t i : loud) {
            if (refused[i]) continue;
            const double says = first ? f.z[i] : excess(i);
            if (first ? loudest(i) : says >= s.leader_sigmas) order.push_back({-says, i});
        }
        std::sort(order.begin(), order.end());
        std::vector<int32_t> ids;
        for (const auto &one : order) ids.push_back(one.second);
        return ids;
    }

    bool loudest(int32_t i) const {
        bool most = true;
        each_within(f.x(i), f.y(i), s.leader_radius, [&](int32_t j) {
            most = most && (j == i || f.z[j] < f.z[i] || (f.z[j] == f.z[i] && j > i));
        });
        return most;
    }

    bool most_excess(int32_t i, double e) {
        bool most = true;
        each_within(f.x(i), f.y(i), s.leader_radius, [&](int32_t j) {
            if (!most || j == i || refused[j] || f.z[j] < s.leader_sigmas * f.sigma[j]) return;
            const double other = excess(j);
            most = other < e || (other == e && j > i);
        });
        return most;
    }

    template <class Visit>
    void each_within(double x, double y, double radius, Visit visit) const {
        sensors.near(x, y, radius, [&](int32_t j) {
            const double dx = f.x(j) - x, dy = f.y(j) - y;
            if (dx * dx + dy * dy <= radius * radius) visit(j);
        });
    }

    Asked ask(const std::vector<int32_t> &loud, bool first) {
        Asked o{0, 0};
        for (int32_t i : speakers(loud, first)) {
            if (!complete()) break;
            const double e = excess(i);
            if (e < s.leader_sigmas || !most_excess(i, e)) continue;
            ++o.asked;
            if (lead(i))
                ++o.added;
            else
                refused[i] = 1;
        }
        return o;
    }

    void open_window(const std::vector<Source> &about, const std::vector<int32_t> &group, int32_t leader) {
        ++mark;
        fitter.sensors.clear();
        const auto take = [&](double x, double y) {
            each_within(x, y, s.fit_radius, [&](int32_t j) {
                if (stamp[j] == mark) return;
                stamp[j] = mark;
                fitter.sensors.push_back(j);
            });
        };
        if (leader >= 0) take(f.x(leader), f.y(leader));
        for (const Source &c : about) take(c.x, c.y);
        fitter.background.clear();
        for (int32_t j : fitter.sensors) fitter.background.push_back(heard(j, group));
    }

    // Centre of mass of what is unexplained about a leader, Oh (12) on residuals.
    Source start_at(int32_t i) {
        double x = 0, y = 0, mass = 0;
        each_within(f.x(i), f.y(i), s.leader_radius, [&](int32_t j) {
            if (refused[j]) return;
            const double r = std::max(0.0, residual_of(f, j, heard(j, {})));
            x += r * f.x(j), y += r * f.y(j), mass += r;
        });
        return {x / mass, y / mass, 0.0, i};
    }

    bool lead(int32_t i) {
        const std::vector<int32_t> group = neighbours(f.x(i), f.y(i), s.group - 1);
        std::vector<Source> start;
        for (int32_t k : group) start.push_back(found[k].source);
        open_window(start, group, i);
        const double before = fitter.judge(start).objective;
        start.push_back(start_at(i));
        Fit best = fitter.run(start);
        for (int k = 0; k < 6 && !best.good() && complete(); ++k) {
            const double turn = k * 1.0471975511965976, arm = 0.5 * s.leader_radius;
            start.back() = {f.x(i) + arm * std::cos(turn), f.y(i) + arm * std::sin(turn), 0.0, i};
            Fit other = fitter.run(start);
            if (other.objective > best.objective) best = other;
        }
        if (!(best.objective - before > s.gain) || !usable(best)) return false;
        for (size_t k = 0; k < group.size(); ++k) put(group[k], best, k);
        found.push_back({best.sources.back()});
        sources.insert(int32_t(found.size()) - 1, best.sources.back().x, best.sources.back().y);
        put(int32_t(found.size()) - 1, best, group.size());
        found.back().gain = best.objective - before;
        return true;
    }

    // Every source stands where its leader can hear it, and has a covariance.
    bool usable(const Fit &fit) const {
        for (size_t k = 0; k < fit.sources.size(); ++k) {
            const Source &c = fit.sources[k];
            if (!(std::hypot(c.x - f.x(c.leader), c.y - f.y(c.leader)) <= f.reach(c.leader))) return false;
            if (!std::isfinite(fit.covariance[3 * k] + fit.covariance[3 * k + 2])) return false;
        }
        return true;
    }

    void put(int32_t k, const Fit &fit, size_t place) {
        Found &one = found[k];
        sources.remove(k, one.source.x, one.source.y);
        one.source = fit.sources[place];
        sources.insert(k, one.source.x, one.source.y);
        std::copy_n(fit.covariance.begin() + 3 * place, 3, one.cov);
        one.misfit = fit.chi2 / double(std::max<size_t>(fit.n, 1));
    }

    std::vector<int32_t> group_of(int32_t k) const {
        std::vector<int32_t> group = neighbours(found[k].source.x, found[k].source.y, s.group - 1, k);
        group.insert(group.begin(), k);
        return group;
    }

    std::vector<Source> of(const std::vector<int32_t> &group) const {
        std::vector<Source> o;
        for (int32_t k : group) o.push_back(found[k].source);
        return o;
    }

    // Each source again, now that all are there; then those that bring too little are taken out.
    void settle() {
        polish();
        polish();
        if (prune()) polish();
    }

    void polish() {
        for (size_t k = 0; k < found.size() && complete(); ++k)
            if (found[k].alive) refit(int32_t(k));
    }

    void refit(int32_t k) {
        const std::vector<int32_t> group = group_of(k);
        const std::vector<Source> now = of(group);
        open_window(now, group, -1);
        const double before = fitter.judge(now).objective;
        const Fit fit = fitter.run(now);
        if (fit.objective < before - 1e-6 || !usable(fit)) return;
        for (size_t j = 0; j < group.size(); ++j) {
            if (j == 0) put(group[j], fit, j);
            else {
                Found &one = found[group[j]];
                sources.remove(group[j], one.source.x, one.source.y);
                one.source = fit.sources[j];
                sources.insert(group[j], one.source.x, one.source.y);
            }
        }
    }

    bool prune() {
        bool any = false;
        for (size_t k = found.size(); k-- > 0 && complete();) {
            if (!found[k].alive) continue;
            std::vector<int32_t> group = group_of(int32_t(k));
            open_window(of(group), group, -1);
            const double with = fitter.judge(of(group)).objective;
            group.erase(group.begin());
            const Fit rest = group.empty() ? fitter.judge({}) : fitter.run(of(group));
            found[k].gain = with - rest.objective;
            if (found[k].gain > s.gain) continue;
            any = true;
            found[k].alive = false;
            sources.remove(int32_t(k), found[k].source.x, found[k].source.y);
            if (!group.empty() && usable(rest))
                for (size_t j = 0; j < group.size(); ++j) put(group[j], rest, j);
        }
        return any;
    }

    const Field &f;
    const Settings &s;
    Fitter fitter;
    Cells sensors, sources;
    std::vector<int32_t> stamp;
    std::vector<char> refused;
    int32_t mark = 0;
};

}  // namespace trackfield::signals
