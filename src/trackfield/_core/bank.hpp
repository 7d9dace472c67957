// Many tagged targets: order, windows, duplicates, start, restart and end of tracks, rows shown.
#pragma once

#include <bit>
#include <cstring>
#include <memory>

#include "archive.hpp"
#include "start.hpp"

namespace trackfield {

enum Status : int32_t { kTentative = 0, kConfirmed = 1, kCoasting = 2, kEnded = 3 };

struct Row {
    double t, position[3], velocity[3], cov[3], nis;
    int32_t track, target, status;
};

struct Counts {
    int64_t accepted = 0, duplicate = 0, late = 0, out_of_range = 0, rewound = 0;
    int64_t started = 0, restarted = 0, ended = 0;  // kept by the targets, since a rewind takes them back
};

// All that one target's future depends on: what a checkpoint copies.
struct State {
    Belief belief;
    std::vector<Reading> recent;  // to start or restart from
    int32_t tracks = 0;           // tracks this target has had
    int32_t restarts = 0, ends = 0;
    double last_row = -1e300;
};

struct Checkpoint {
    double t = 0;  // of the last scan applied
    State state;
};

struct TargetRecord {
    int32_t id = 0, variant = 0;
    State live;
    std::vector<std::unique_ptr<Checkpoint>> checkpoints;  // the first `used` count
    size_t used = 0;
    std::vector<Reading> window;  // applied readings a rewind may need, by time
    std::vector<Reading> open;    // the scan that may still grow
    int32_t open_highest = -1;    // highest sensor number in it
    double latest = -1e300;       // time of the last scan applied
    double shown = -1e300;        // rows up to here were given out
    double dirty = 1e300;         // earliest late reading not yet replayed
};

template <class Ar> void visit(Ar &ar, State &s) { visit_all(ar, s.belief, s.recent, s.tracks, s.restarts, s.ends, s.last_row); }
template <class Ar> void visit(Ar &ar, Checkpoint &c) { visit_all(ar, c.t, c.state); }
template <class Ar> void visit(Ar &ar, TargetRecord &r) {
    uint64_t used = r.used;
    visit(ar, used);
    if constexpr (Ar::reading) {
        if (used > size_t(ar.end - ar.at)) throw std::runtime_error("the snapshot is damaged");
        r.used = used;
        r.checkpoints.clear();
        while (r.checkpoints.size() < used) r.checkpoints.push_back(std::make_unique<Checkpoint>());
    }
    for (size_t i = 0; i < r.used; ++i) visit(ar, *r.checkpoints[i]);
    visit_all(ar, r.id, r.variant, r.live, r.window, r.open, r.open_highest, r.latest, r.shown, r.dirty);
}
template <class Ar> void visit(Ar &ar, Row &r) {
    for (int i = 0; i < 3; ++i) visit_all(ar, r.position[i], r.velocity[i], r.cov[i]);
    visit_all(ar, r.t, r.nis, r.track, r.target, r.status);
}
template <class Ar> void visit(Ar &ar, Counts &c) {
    visit_all(ar, c.accepted, c.duplicate, c.late, c.out_of_range, c.rewound);
}

class Bank {
  public:
    std::vector<std::unique_ptr<RangeFilter>> filters;  // one a variant of the sensors' models
    std::vector<TargetRecord> targets;
    std::vector<Row> rows;
    Counts counts;
    std::vector<uint8_t> heard;  // sensors that have spoken

    Bank(const Settings &s, const std::vector<SensorModel> &sensors) : heard(sensors.size(), 0), s(s) {
        filters.push_back(std::make_unique<RangeFilter>(s, sensors));
        smoothing_ = s.lag_time > 0 || s.lag_steps > 0;
    }

    Bank(const Bank &) = delete;
    Bank &operator=(const Bank &) = delete;

    int32_t add_variant(const std::vector<SensorModel> &sensors) {
        filters.push_back(std::make_unique<RangeFilter>(s, sensors));
        return int32_t(filters.size()) - 1;
    }

    void assign(int32_t target, int32_t variant) { record(target).variant = variant; }

    void add(int32_t target, const Reading &z) {
        TargetRecord &r = record(target);
        const SensorModel &a = filter(r).sensors_[z.sensor];
        heard[z.sensor] = 1;
        if (std::abs(z.value) > a.longest) { ++counts.out_of_range; return; }
        const double newest = r.open.empty() ? r.latest : r.open.front().t;
        if (z.t > newest) {
            close(r);
            r.open.push_back(z);
            r.open_highest = z.sensor;
            ++counts.accepted;
            return;
        }
        if (!r.open.empty() && z.t == newest) {
            if (z.sensor <= r.open_highest)  // most scans come in the order of their sensors
                for (const Reading &o : r.open)
                    if (o.sensor == z.sensor) { ++counts.duplicate; return; }
            r.open_highest = std::max(r.open_highest, z.sensor);
            r.open.push_back(z);
            ++counts.accepted;
            return;
        }
        if (s.window <= 0 || z.t < newest - s.window) { ++counts.late; return; }
        auto at = std::lower_bound(r.window.begin(), r.window.end(), z.t,
                                   [](const Reading &o, double t) { return o.t < t; });
        auto end = at;
        for (; end != r.window.end() && end->t == z.t; ++end)
            if (end->sensor == z.sensor) { ++counts.duplicate; return; }
        r.window.insert(end, z);
        r.dirty = std::min(r.dirty, z.t);
        ++counts.accepted;
    }

    // No reading of a time up to the watermark will come any more.
    void advance(double watermark) {
        for (TargetRecord &r : targets) {
            if (!r.open.empty() && r.open.front().t <= watermark) close(r);
            else if (r.dirty < 1e300) replay(r);
            if (s.every > 0) coast(r, watermark);
            const Belief &b = r.live.belief;
            if (r.open.empty() && b.alive && watermark - b.last_update > s.drop_time) end(r);
        }
    }

    Counts total() const {
        Counts sum = counts;
        for (const TargetRecord &r : targets) {
            sum.started += r.live.tracks;
            sum.restarted += r.live.restarts;
            sum.ended += r.live.ends;
        }
        return sum;
    }

    // One target's scan is complete.
    void settle(int32_t target) { close(record(target)); }

    void finish() {
        for (TargetRecord &r : targets) {
            close(r);
            if (r.dirty < 1e300) replay(r);
            flush(r, true);
        }
    }

    std::string snapshot() {
        Writer ar;
        visit_all(ar, targets, rows, counts, heard);
        return ar.bytes;
    }

    void restore(const char *data, size_t size) {
        Reader ar{data, data + size};
        std::vector<TargetRecord> t;
        std::vector<Row> r;
        Counts c;
        std::vector<uint8_t> h;
        visit_all(ar, t, r, c, h);
        if (h.size() != heard.size()) throw std::runtime_error("the snapshot is of other sensors");
        if (ar.at != ar.end) throw std::runtime_error("the snapshot is longer than its contents");
        targets = std::move(t);
        rows = std::move(r);
        counts = c;
        heard = std::move(h);
    }

  private:
    const Settings s;
    bool smoothing_ = false;

    RangeFilter &filter(const TargetRecord &r) { return *filters[r.variant]; }

    TargetRecord &record(int32_t target) {
        if (size_t(target) >= targets.size()) {
            const size_t before = targets.size();
            targets.resize(size_t(target) + 1);
            for (size_t i = before; i < targets.size(); ++i) targets[i].id = int32_t(i);
        }
        return targets[target];
    }

    void close(TargetRecord &r) {
        if (r.dirty < 1e300) replay(r);
        if (r.open.empty()) return;
        if (s.every > 0) coast(r, r.open.front().t);
        apply(r, r.open);
        if (s.window > 0) r.window.insert(r.window.end(), r.open.begin(), r.open.end());
        r.latest = r.open.front().t;
        r.open.clear();
        checkpoint(r);
        forget(r);
    }

    void checkpoint(TargetRecord &r) {
        if (s.window <= 0 || (r.used && r.latest - r.checkpoints[r.used - 1]->t < s.window / 4)) return;
        if (r.used == r.checkpoints.size()) r.checkpoints.push_back(std::make_unique<Checkpoint>());
        Checkpoint &c = *r.checkpoints[r.used++];  // an old one's memory serves again
        c.t = r.latest;
        c.state = r.live;
    }

    // Keeps one checkpoint before the window, and the readings after it.
    void forget(TargetRecord &r) {
        size_t k = 0;
        while (k + 1 < r.used && r.checkpoints[k + 1]->t < r.latest - s.window) ++k;
        if (!k) return;
        std::rotate(r.checkpoints.begin(), r.checkpoints.begin() + k, r.checkpoints.begin() + r.used);
        r.used -= k;
        const double t = r.checkpoints.front()->t;
        size_t gone = 0;
        while (gone < r.window.size() && r.window[gone].t <= t) ++gone;
        r.window.erase(r.window.begin(), r.window.begin() + gone);
    }

    // Goes back to before the earliest late reading and applies all that came since.
    void replay(TargetRecord &r) {
        ++counts.rewound;
        size_t keep = r.used;
        while (keep > 0 && r.checkpoints[keep - 1]->t >= r.dirty) --keep;
        r.live = keep ? r.checkpoints[keep - 1]->state : State{};
        const double from = keep ? r.checkpoints[keep - 1]->t : -1e300;
        r.used = keep;
        r.dirty = 1e300;
        std::vector<Reading> scan;
        for (size_t i = 0; i < r.window.size();) {
            const double t = r.window[i].t;
            scan.clear();
            while (i < r.window.size() && r.window[i].t == t) scan.push_back(r.window[i++]);
            if (t <= from) continue;
            apply(r, scan);
            r.latest = t;
            checkpoint(r);
        }
    }

    void apply(TargetRecord &r, const std::vector<Reading> &scan) {
        const double t = scan.front().t;
        State &st = r.live;
        Belief &b = st.belief;
        if (b.alive && t - b.last_update > s.drop_time) end(r);
        st.recent.insert(st.recent.end(), scan.begin(), scan.end());
        trim(st.recent, t);
        if (!b.alive) {
            if (start(r, t)) show(r, kTentative, NAN);
            return;
        }
        RangeFilter &f = filter(r);
        f.predict(b, t, scan, smoothing_);
        const double nis = judge(f, b, scan);
        f.update(b, scan, smoothing_);
        if (lost(b) && restart(r, t)) { show(r, kTentative, nis); return; }
        show(r, b.step < 3 ? kTentative : kConfirmed, nis);
    }

    static void trim(std::vector<Reading> &recent, double t) {
        // In batches, so that most scans move nothing.
        if (recent.size() < 64 && recent.front().t > t - 20) return;
        size_t gone = 0;
        while (gone < recent.size() && (recent[gone].t < t - 10 || recent.size() - gone > 32)) ++gone;
        recent.erase(recent.begin(), recent.begin() + gone);
    }

    // Mean of min(NIS, 9) of the readings against the prediction; remembers who surprised.
    double judge(RangeFilter &f, Belief &b, const std::vector<Reading> &scan) {
        if (!smoothing_) f.combine(b);
        const int n = f.L.n;
        double total = 0;
        for (const Reading &z : scan) {
            Jacobian H;
            f.linearize(b.m.data(), z.sensor, b, H);
            const double e = z.value - H.expected;
            const double S = f.variance(b, z, H.distance) + H.spread(b.P.data(), n);
            const double nis = e * e / S;
            total += std::min(nis, 9.0);
            b.surprises = b.surprises << 1 | uint32_t(nis > 9);
        }
        return total / double(scan.size());
    }

    // Did more than half of the last readings surprise?
    bool lost(const Belief &b) const {
        const uint32_t last = b.surprises & ((1u << s.restart_window) - 1);
        return 2 * std::popcount(last) > s.restart_window;
    }

    // The newest readings that suffice to start from: old ones only blur a moving target. Who has
    // waited for long starts from fewer sensors.
    bool enough(const std::vector<Reading> &zs, double t, bool all, std::vector<Reading> &use) const {
        const bool waited = zs.front().t < t - s.start_span;
        const int sensors = waited ? std::min(s.start_sensors, s.dimensions + 1) : s.start_sensors;
        std::vector<int32_t> seen;
        use.clear();
        for (size_t i = zs.size(); i-- > 0 && zs[i].t >= t - s.start_span;) {
            const bool full = int(use.size()) >= s.start_readings && int(seen.size()) >= sensors;
            if (!all && full && zs[i].t < use.back().t) break;
            use.push_back(zs[i]);
            if (std::find(seen.begin(), seen.end(), zs[i].sensor) == seen.end()) seen.push_back(zs[i].sensor);
        }
        return int(use.size()) >= s.start_readings && int(seen.size()) >= sensors;
    }

    bool start(TargetRecord &r, double t) {
        RangeFilter &f = filter(r);
        std::vector<Reading> use;
        if (!enough(r.live.recent, t, false, use)) return false;
        Start found = find_start(f, use, t);
        if (found.rival - found.cost < kClear && enough(r.live.recent, t, true, use)) found = find_start(f, use, t);
        const bool waited = r.live.recent.front().t < t - s.start_span;
        if (!found.found || (found.rival - found.cost < kClear && !waited)) return false;
        Belief &b = r.live.belief;
        f.init(b, t, found.position, found.cov);
        b.track = r.live.tracks++;
        return true;
    }

    // A restart must explain the last readings clearly better than the track does.
    bool restart(TargetRecord &r, double t) {
        RangeFilter &f = filter(r);
        Belief &b = r.live.belief;
        std::vector<Reading> use;
        if (!enough(r.live.recent, t, false, use)) return false;
        const Start found = find_start(f, use, t);
        if (!found.found || found.cost > 0.5 * start_cost(f, use, t, b.m.data())) return false;
        // What was learned of the noise counts less, for part of it was the lost track's; pending rows
        // learn nothing from across the break.
        Belief fresh;
        f.init(fresh, t, found.position, found.cov);
        fresh.track = b.track;
        fresh.pool_weight = kKept * b.pool_weight;
        fresh.pool_power = kKept * b.pool_power;
        fresh.heard = kKept * b.heard;
        fresh.heard_nlos = kKept * b.heard_nlos;
        fresh.heard_outlier = kKept * b.heard_outlier;
        fresh.step = b.step;
        fresh.pending = std::move(b.pending);
        for (Pending &p : fresh.pending) std::fill(p.gain.begin(), p.gain.end(), 0.0);
        b = std::move(fresh);
        ++r.live.restarts;
        return true;
    }

    void end(TargetRecord &r) {
        Belief &b = r.live.belief;
        flush(r, true);
        filter(r).predict(b, b.last_update + s.drop_time, {}, false);
        filter(r).combine(b);
        emit(r, row_of(r, b.t, kEnded, NAN));
        b = Belief{};
        r.live.recent.clear();
        ++r.live.ends;
    }

    Row row_of(TargetRecord &r, double t, Status status, double nis) {
        const Belief &b = r.live.belief;
        const RangeFilter &f = filter(r);
        const int n = f.L.n, D = f.L.D;
        Row o{};
        o.t = t;
        o.position[2] = o.velocity[2] = NAN;
        for (int i = 0; i < D; ++i) { o.position[i] = b.m[i]; o.velocity[i] = b.m[D + i]; }
        if (f.L.height >= 0) o.position[2] = b.m[f.L.height];
        set_covariance(o, f, b.P.data(), n);
        o.track = b.track;
        o.target = r.id;
        o.status = status;
        o.nis = nis;
        return o;
    }

    static void set_covariance(Row &o, const RangeFilter &f, const double *P, int n) {
        o.cov[0] = P[0] + f.placement;
        o.cov[1] = P[1];
        o.cov[2] = P[n + 1] + f.placement;
    }

    void emit(TargetRecord &r, const Row &row) {
        if (row.t <= r.shown) return;  // never revised
        r.shown = row.t;
        rows.push_back(row);
    }

    void show(TargetRecord &r, Status status, double nis) {
        State &st = r.live;
        Belief &b = st.belief;
        const bool due = s.every <= 0 || b.t >= st.last_row + s.every - 1e-9;
        if (due) st.last_row = b.t;
        if (!smoothing_) {
            if (due) emit(r, row_of(r, b.t, status, nis));
            return;
        }
        if (due) {
            const RangeFilter &f = filter(r);
            const int n = f.L.n, W = 2 * f.L.D;
            Pending p;
            p.t = b.t;
            p.step = b.step;
            p.status = status;
            p.nis = nis;
            p.mean.assign(b.m.begin(), b.m.begin() + W);
            p.cov.resize(size_t(W) * W);
            p.gain.assign(size_t(W) * n, 0.0);
            for (int i = 0; i < W; ++i) {
                p.gain[i * n + i] = 1;
                for (int k = 0; k < W; ++k) p.cov[i * W + k] = b.P[i * n + k];
            }
            b.pending.push_back(std::move(p));
        }
        flush(r, false);
    }

    void flush(TargetRecord &r, bool all) {
        Belief &b = r.live.belief;
        const RangeFilter &f = filter(r);
        const int W = 2 * f.L.D, D = f.L.D;
        size_t done = 0;
        for (const Pending &p : b.pending) {
            const bool ripe = s.lag_steps > 0 ? b.step - p.step >= s.lag_steps : b.t - p.t >= s.lag_time - 1e-9;
            if (!all && !ripe) break;
            Row o{};
            o.t = p.t;
            o.position[2] = o.velocity[2] = NAN;
            for (int i = 0; i < D; ++i) { o.position[i] = p.mean[i]; o.velocity[i] = p.mean[D + i]; }
            if (f.L.height >= 0) o.position[2] = b.m[f.L.height];
            set_covariance(o, f, p.cov.data(), W);
            o.track = b.track;
            o.target = r.id;
            o.status = p.status;
            o.nis = p.nis;
            emit(r, o);
            ++done;
        }
        b.pending.erase(b.pending.begin(), b.pending.begin() + done);
    }

    // Rows for a silent target on the grid of `every`, from prediction alone.
    void coast(TargetRecord &r, double until) {
        State &st = r.live;
        if (smoothing_ || !st.belief.alive) return;
        const double gap = std::max(2 * s.every, 1.0);
        const double stop = std::min(until, st.belief.last_update + s.drop_time);
        if (st.last_row + gap > stop) return;
        const Belief kept = st.belief;
        RangeFilter &f = filter(r);
        while (st.last_row + gap <= stop) {
            const double t = st.last_row + s.every;
            st.belief = kept;
            f.predict(st.belief, t, {}, false);
            f.combine(st.belief);
            emit(r, row_of(r, t, kCoasting, NAN));
            st.last_row = t;
        }
        st.belief = kept;
    }

    static constexpr double kKept = 0.1;  // of what was learned, over a restart
    static constexpr double kClear = 4;  // a start's lead over its rival, in units of 2 log-likelihood
};

}  // namespace trackfield
