// What is believed of a target now or some scans ago: smoothing along its histories.
#pragma once

#include <array>
#include <cmath>

#include "bernoulli_draft.hpp"

namespace trackfield {

using Matrix4 = std::array<double, 16>;

inline Matrix4 dense(const Plane &p) {
    return {p.A.xx, p.A.xy, p.xu, p.xw, p.A.xy, p.A.yy, p.yu, p.yw, p.xu, p.yu, p.C.xx, p.C.xy, p.xw, p.yw, p.C.xy, p.C.yy};
}

inline Plane plane(const std::array<double, 4> &m, const Matrix4 &P) {
    Plane p;
    p.x = m[0];
    p.y = m[1];
    p.vx = m[2];
    p.vy = m[3];
    p.A = {P[0], P[1], P[5]};
    p.xu = P[2];
    p.xw = P[3];
    p.yu = P[6];
    p.yw = P[7];
    p.C = {P[10], P[11], P[15]};
    return p;
}

// Rauch, Tung, Striebel: the belief at a scan, given what is known of the one after it.
inline Plane smoothed(const Plane &filtered, const Plane &after, double h, double n, double accel_sigma) {
    Plane predicted = filtered;
    predicted.predict(h, n, accel_sigma);
    const double dt = h * n;
    const Matrix4 P = dense(filtered), S = dense(predicted), T = dense(after);
    Matrix4 L{}, G{};
    for (int i = 0; i < 4; ++i)  // S = L L'
        for (int j = 0; j <= i; ++j) {
            double v = S[4 * i + j];
            for (int k = 0; k < j; ++k) v -= L[4 * i + k] * L[4 * j + k];
            L[4 * i + j] = i == j ? std::sqrt(std::max(v, 1e-18)) : v / L[4 * j + j];
        }
    for (int r = 0; r < 4; ++r) {  // G = P F' S^-1, row by row
        double y[4];
        for (int c = 0; c < 4; ++c) y[c] = P[4 * r + c] + (c < 2 ? dt * P[4 * r + c + 2] : 0);
        for (int i = 0; i < 4; ++i) {
            for (int k = 0; k < i; ++k) y[i] -= L[4 * i + k] * y[k];
            y[i] /= L[4 * i + i];
        }
        for (int i = 4; i-- > 0;) {
            for (int k = i + 1; k < 4; ++k) y[i] -= L[4 * k + i] * y[k];
            y[i] /= L[4 * i + i];
            G[4 * r + i] = y[i];
        }
    }
    const double d[4] = {after.x - predicted.x, after.y - predicted.y, after.vx - predicted.vx, after.vy - predicted.vy};
    std::array<double, 4> m{filtered.x, filtered.y, filtered.vx, filtered.vy};
    Matrix4 D, GD{}, Q = P;
    for (int k = 0; k < 16; ++k) D[k] = T[k] - S[k];
    for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 4; ++j) {
            m[i] += G[4 * i + j] * d[j];
            for (int k = 0; k < 4; ++k) GD[4 * i + j] += G[4 * i + k] * D[4 * k + j];
        }
    for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 4; ++j)
            for (int k = 0; k < 4; ++k) Q[4 * i + j] += GD[4 * i + k] * G[4 * j + k];
    return plane(m, Q);
}

struct Believed {
    int32_t id = 0;
    double first = 0, existence = 0;
    Plane state;
    bool detected = false, shown = false;
    Recent recent{};  // of the likeliest history
};

class Hindsight {
  public:
    Hindsight(const BernoulliModel &model, const BernoulliState &state) : m_(model), s_(state) {}

    // Beliefs about the scan `lag` before the newest, which must be there, in targets that are as likely as told.
    std::vector<Believed> at(size_t lag, double least = 0) const {
        const size_t newest = s_.frames.size() - 1, k = newest - lag;
        std::vector<Believed> out;
        std::vector<int32_t> done;
        for (size_t j = newest + 1; j-- > k;) {  // a track that has ended since is judged by its last scan
            const Frame &frame = *s_.frames[j];
            const size_t before = out.size();
            for (const Track &track : frame.tracks) {
                if (track.first > s_.frames[k]->t) continue;
                if (std::binary_search(done.begin(), done.end(), track.id)) continue;
                if (least > 0 && existence(frame, track) < least) continue;
                out.push_back(believe(track, j, k));
            }
            for (size_t i = before; i < out.size(); ++i) done.push_back(out[i].id);
            std::sort(done.begin(), done.end());
        }
        std::erase_if(out, [](const Believed &b) { return b.existence <= 0; });
        std::sort(out.begin(), out.end(), [](const Believed &a, const Believed &b) { return a.id < b.id; });
        return out;
    }

  private:
    const BernoulliModel &m_;
    const BernoulliState &s_;

    static double existence(const Frame &frame, const Track &track) {
        double r = 0;
        for (int32_t l = track.begin; l < track.end; ++l) r += frame.leaves[l].weight * frame.leaves[l].existence;
        return r;
    }

    Believed believe(const Track &track, size_t j, size_t k) const {
        std::vector<Leaf> past;
        for (int32_t l = track.begin; l < track.end; ++l) {
            Leaf leaf = s_.frames[j]->leaves[l];
            if (trace(leaf, j, k)) past.push_back(leaf);
        }
        Believed b;
        b.id = track.id;
        b.first = track.first;
        if (past.empty()) return b;
        for (const Leaf &leaf : past) b.existence += leaf.weight * leaf.existence;
        const Leaf &best = likeliest(past);
        b.detected = best.report() >= 0;
        b.recent = best.recent;
        Moments moments;
        for (const Leaf &leaf : past) {
            const double w = leaf.weight * leaf.existence;
            if (w > 0 && std::hypot(leaf.state.x - best.state.x, leaf.state.y - best.state.y) <= m_.near) moments.add(leaf.state, w);
        }
        if (moments.total() <= 0) {
            b.existence = 0;
            return b;
        }
        b.state = moments.mixed();
        // Showing costs (1 - R) c^2/2 + R e^2, hiding R c^2/2: the better one for GOSPA.
        const double c2 = m_.cutoff * m_.cutoff, e2 = std::min(b.state.A.trace(), c2 / 2);
        b.shown = b.existence > c2 / 2 / (c2 - e2);
        return b;
    }

    // Takes a leaf of scan j back to scan k; false if its history does not reach so far.
    bool trace(Leaf &leaf, size_t j, size_t k) const {
        for (; j > k; --j) {
            if (leaf.parent < 0) return false;
            const Frame &frame = *s_.frames[j - 1];
            Leaf before = frame.leaves[leaf.parent];
            const double dt = s_.frames[j]->t - frame.t, n = std::max(1.0, std::round(dt / m_.step));
            before.state = smoothed(before.state, leaf.state, dt / n, n, m_.accel_sigma);
            // P(there then) = P(there after) + P(gone after) P(there then | gone after).
            const double r = before.existence, s = leaf.survival;
            before.existence = leaf.existence + (1 - leaf.existence) * r * (1 - s) / std::max(1 - r * s, 1e-300);
            before.weight = leaf.weight;
            leaf = before;
        }
        return true;
    }
};

}  // namespace trackfield
