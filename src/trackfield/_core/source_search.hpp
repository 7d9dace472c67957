// Sources of one scan: leaders speak, each is fitted with its neighbours, what brings too little goes.
#pragma once

#include "source_set.hpp"

namespace trackfield::signals {

constexpr size_t kMany = 30;                  // readings that leave no second place for a source
constexpr double kSixth = 1.0471975511965976;  // of a turn [rad]

class Search {
   public:
    std::vector<int32_t> suspects;  // sensors that say much which no source explains
    int64_t spent = 0;

    Search(const Field &field, const Settings &settings)
        : f(field), s(settings), fitter(f, s, spent), sensors(f, cell_width()), most_reach(reach()), set(f, most_reach, spent), found(set.found) {
        stamp.assign(f.n, 0);
        refused.assign(f.n, 0);
    }

    const std::vector<Found> &sources() const { return set.found; }
    bool complete() const { return spent < s.work; }

    void run() {
        std::vector<int32_t> loud;
        for (size_t i = 0; i < f.n; ++i)
            if (f.spoke(i) && f.z[i] >= s.leader_sigmas * f.sigma[i]) loud.push_back(int32_t(i));
        for (int round = 0; round < s.rounds && complete(); ++round) {
            const auto [added, asked] = ask(loud, round == 0);
            if (asked == 0) break;
            if (added > 0) settle();
        }
        if (prune()) polish(false);
        suspect(loud);
    }

   private:
    struct Asked {
        int added, asked;
    };

    // Leaders that were not believed and still stand out; and near sources, whoever is far off.
    void suspect(const std::vector<int32_t> &loud) {
        for (int32_t i : loud)
            if (refused[i] && set.excess(i) >= s.leader_sigmas) suspects.push_back(i);
        for (const Found &one : found) {
            if (!one.alive) continue;
            sensors.within(one.source.x, one.source.y, s.fit_radius, [&](int32_t i) {
                if (std::fabs(set.excess(i)) >= s.outlier_sigmas) suspects.push_back(i);
            });
        }
        std::sort(suspects.begin(), suspects.end());
        suspects.erase(std::unique(suspects.begin(), suspects.end()), suspects.end());
    }

    double reach() const {
        double most = 0;
        for (size_t i = 0; i < f.n; ++i) most = std::max(most, f.reach(i));
        return most;
    }
    double cell_width() const { return std::max(s.leader_radius, 0.5 * s.fit_radius); }

    // Leaders in order: the loudest of their neighbourhood first, later those with the most excess.
    std::vector<int32_t> speakers(const std::vector<int32_t> &loud, bool first) {
        std::vector<std::pair<double, int32_t>> order;
        for (int32_t i : loud) {
            if (refused[i]) continue;
            const double says = first ? f.z[i] : set.excess(i);
            if (first ? loudest(i) : says >= s.leader_sigmas) order.push_back({-says, i});
        }
        std::sort(order.begin(), order.end());
        std::vector<int32_t> ids;
        for (const auto &one : order) ids.push_back(one.second);
        return ids;
    }

    bool loudest(int32_t i) const {
        bool most = true;
        sensors.within(f.x(i), f.y(i), s.leader_radius, [&](int32_t j) {
            if (j != i && (f.z[j] > f.z[i] || (f.z[j] == f.z[i] && j < i))) most = false;
        });
        return most;
    }

    bool most_excess(int32_t i, double e) {
        bool most = true;
        sensors.within(f.x(i), f.y(i), s.leader_radius, [&](int32_t j) {
            if (!most || j == i || refused[j] || f.z[j] < s.leader_sigmas * f.sigma[j]) return;
            const double other = set.excess(j);
            most = other < e || (other == e && j > i);
        });
        return most;
    }

    Asked ask(const std::vector<int32_t> &loud, bool first) {
        Asked o{0, 0};
        for (int32_t i : speakers(loud, first)) {
            if (!complete()) break;
            const double e = set.excess(i);
            if (e < s.leader_sigmas || (first && e < 0.5 * f.z[i] / f.sigma[i]) || !most_excess(i, e)) continue;
            ++o.asked;
            if (lead(i, first))
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
            sensors.within(x, y, s.fit_radius, [&](int32_t j) {
                if (stamp[j] == mark) return;
                stamp[j] = mark;
                fitter.sensors.push_back(j);
            });
        };
        if (leader >= 0) take(f.x(leader), f.y(leader));
        for (const Source &c : about) take(c.x, c.y);
        double x = leader >= 0 ? f.x(leader) : about[0].x, y = leader >= 0 ? f.y(leader) : about[0].y, far = 0;
        for (const Source &c : about) far = std::max(far, std::hypot(c.x - x, c.y - y));
        const std::vector<int32_t> others = set.others(x, y, far + s.fit_radius + most_reach, group);
        spent += int64_t(others.size() * fitter.sensors.size());
        fitter.background.assign(fitter.sensors.size(), Signal());
        for (size_t j = 0; j < fitter.sensors.size(); ++j)
            for (int32_t k : others)
                add(f, fitter.background[j], signal_of(f, size_t(fitter.sensors[j]), found[k].source));
    }

    // Centre of mass of what is unexplained about a leader, Oh (12) on residuals.
    Source start_at(int32_t i) {
        double x = 0, y = 0, mass = 0;
        sensors.within(f.x(i), f.y(i), s.leader_radius, [&](int32_t j) {
            if (refused[j]) return;
            const double r = std::max(0.0, residual_of(f, j, set.heard(j)));
            x += r * f.x(j), y += r * f.y(j), mass += r;
        });
        return {x / mass, y / mass, 0.0, i};
    }

    // A source comes in if the log-likelihood gains enough, or else if it explains half of what is
    // there: the rest may be of others that have not spoken yet. What gained nothing in the end goes.
    // The loudest of a neighbourhood shows well where its source is; what others left over does not,
    // and may be half of a pair that one source was fitted to: more starts are tried.
    bool lead(int32_t i, bool first) {
        const std::vector<int32_t> group = set.neighbours(f.x(i), f.y(i), s.group_radius, s.group - 1);
        std::vector<Source> start = set.of(group);
        open_window(start, group, i);
        const Fit before = fitter.judge(start);
        start.push_back(start_at(i));
        Fit best = fitter.run(start, Trust::all);
        if (!best.good()) better(best, fitter.run(start, Trust::soft));
        if (!best.good() && !(first && best.n >= kMany && worthy(best, before))) {
            for (int k = 0; k < 6 && complete(); ++k) {
                const double turn = k * kSixth, arm = 0.5 * s.leader_radius;
                start.back() = {f.x(i) + arm * std::cos(turn), f.y(i) + arm * std::sin(turn), 0.0, i};
                better(best, fitter.run(start, Trust::all, kTrialIterations));
            }
            better(best, fitter.run(best.sources, Trust::all));
        }
        if (!worthy(best, before) || !usable(best)) return false;
        set.add_last(best, group, best.objective - before.objective);
        return true;
    }

    bool worthy(const Fit &fit, const Fit &before) const {
        return fit.objective - before.objective > s.gain || fit.chi2 < 0.5 * before.chi2;
    }

    static void better(Fit &best, Fit other) {
        if (other.objective > best.objective) best = std::move(other);
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

    std::vector<int32_t> group_of(int32_t k) const {
        const Source &at = found[k].source;
        std::vector<int32_t> group = set.neighbours(at.x, at.y, s.group_radius, s.group - 1, k);
        group.insert(group.begin(), k);
        return group;
    }

    // Each source again, now that all are there.
    void settle() {
        polish(false);
        polish(true);
        if (split()) polish(false);
    }

    void polish(bool elsewhere) {
        for (size_t k = 0; k < found.size() && complete(); ++k)
            if (found[k].alive) refit(int32_t(k), elsewhere);
    }

    void refit(int32_t k, bool elsewhere) {
        const std::vector<int32_t> group = group_of(k);
        const std::vector<Source> now = set.of(group);
        open_window(now, group, -1);
        Fit fit = fitter.run(now, Trust::settled);
        const double before = fit.start;
        if (!fit.good()) better(fit, fitter.run(now, Trust::soft));
        if (!fit.good() && elsewhere) {
            std::vector<Source> start = fit.sources;
            const Source at = start[0];
            for (int j = 0; j < 6 && complete(); ++j) {
                const double turn = j * kSixth, arm = s.leader_radius;
                start[0] = {at.x + arm * std::cos(turn), at.y + arm * std::sin(turn), at.log_factor, at.leader};
                better(fit, fitter.run(start, Trust::all, kTrialIterations));
            }
            better(fit, fitter.run(fit.sources, Trust::settled));
        }
        if (fit.objective < before - 1e-6 || !usable(fit)) return;
        set.put(k, fit, 0);
        for (size_t j = 1; j < group.size(); ++j) set.shift(group[j], fit.sources[j]);
    }

    // One source of free strength can look like two: each is tried as a pair, in three directions.
    bool split() {
        bool any = false;
        if (f.factor_sigma == 0) return any;
        for (size_t k = 0; k < found.size() && complete(); ++k) {
            Found &one = found[k];
            if (!one.alive || one.whole) continue;
            one.whole = true;
            any = halve(int32_t(k)) || any;
        }
        return any;
    }

    bool halve(int32_t k) {
        std::vector<int32_t> group = group_of(k);
        if (int(group.size()) > std::max(s.group - 1, 1)) group.resize(std::max(s.group - 1, 1));
        const std::vector<Source> now = set.of(group);
        open_window(now, group, -1);
        const double before = fitter.judge(now).objective;
        Fit best;
        best.objective = -INFINITY;
        for (int turn = 0; turn < 3 && complete(); ++turn) {
            const double arm = 0.5 * s.leader_radius, dx = arm * std::cos(turn * kSixth),
                         dy = arm * std::sin(turn * kSixth);
            std::vector<Source> start = now;
            start.push_back(now[0]);
            start.front().x += dx, start.front().y += dy;
            start.back().x -= dx, start.back().y -= dy;
            start.front().log_factor = start.back().log_factor -= 0.6931471805599453;
            better(best, fitter.run(start, Trust::all, kTrialIterations));
        }
        if (best.sources.empty()) return false;
        better(best, fitter.run(best.sources, Trust::all));
        if (!(best.objective - before > s.split_gain) || !usable(best)) return false;
        set.add_last(best, group, best.objective - before);
        return true;
    }

    bool prune() {
        const double least = std::min(s.gain, s.split_gain);
        bool any = false;
        for (size_t k = found.size(); k-- > 0 && complete();) {
            if (!found[k].alive) continue;
            std::vector<int32_t> group = group_of(int32_t(k));
            open_window(set.of(group), group, -1);
            const double with = fitter.judge(set.of(group)).objective;
            group.erase(group.begin());
            const Fit rest = group.empty() ? fitter.judge({}) : fitter.run(set.of(group), Trust::settled);
            found[k].gain = with - rest.objective;
            if (found[k].gain > least) continue;
            any = true;
            set.remove(int32_t(k));
            if (!group.empty() && usable(rest))
                for (size_t j = 0; j < group.size(); ++j) set.put(group[j], rest, j);
        }
        return any;
    }

    const Field &f;
    const Settings &s;
    Fitter fitter;
    SensorIndex sensors;
    double most_reach;
    SourceSet set;
    std::vector<Found> &found;
    std::vector<int32_t> stamp;
    std::vector<char> refused;
    int32_t mark = 0;
};

}  // namespace trackfield::signals
