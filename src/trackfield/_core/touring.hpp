// The shortest path from a start through discs in their order: path following with Newton's method.
//
//   minimise sum_k |x_k - x_{k-1}|  over  |x_k - c_k| <= r_k
//
// In the conic form with lengths t_k the barrier -log(t_k^2 - |d_k|^2), d_k = x_k - x_{k-1}, leaves
// t_k = mu + sqrt(mu^2 + |d_k|^2) in closed form; what remains is smooth and self-concordant in x,
// with a block tridiagonal Hessian, so that a Newton step costs O(n).
//
// Duality: |d| >= p.d for every |p| <= 1, so that with q_k = p_k - p_{k+1}, p_{n+1} = 0,
//   length >= sum_k (c_k.q_k - r_k |q_k|) - p_1.start
// for ANY such p. The gradients p_k = d_k / t_k of the barrier are such; they close the gap with mu.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

namespace trackfield {

struct Vec2 {
    double x = 0, y = 0;
};
inline Vec2 operator+(Vec2 a, Vec2 b) { return {a.x + b.x, a.y + b.y}; }
inline Vec2 operator-(Vec2 a, Vec2 b) { return {a.x - b.x, a.y - b.y}; }
inline Vec2 operator*(double s, Vec2 a) { return {s * a.x, s * a.y}; }
inline double dot(Vec2 a, Vec2 b) { return a.x * b.x + a.y * b.y; }
inline double norm(Vec2 a) { return std::sqrt(dot(a, a)); }

// A symmetric 2 x 2 matrix.
struct Sym2 {
    double xx = 0, xy = 0, yy = 0;
};
inline Sym2 operator+(Sym2 a, Sym2 b) { return {a.xx + b.xx, a.xy + b.xy, a.yy + b.yy}; }
inline Sym2 operator-(Sym2 a, Sym2 b) { return {a.xx - b.xx, a.xy - b.xy, a.yy - b.yy}; }
inline Vec2 operator*(Sym2 m, Vec2 v) { return {m.xx * v.x + m.xy * v.y, m.xy * v.x + m.yy * v.y}; }
// s I + w v v'
inline Sym2 spread(double s, double w, Vec2 v) { return {s + w * v.x * v.x, w * v.x * v.y, s + w * v.y * v.y}; }
inline Sym2 inverse(Sym2 m) {
    const double d = m.xx * m.yy - m.xy * m.xy;
    return {m.yy / d, -m.xy / d, m.xx / d};
}
// b a^-1 b for symmetric a^-1, b
inline Sym2 congruent(Sym2 b, Sym2 inv) {
    const Vec2 u = inv * Vec2{b.xx, b.xy}, v = inv * Vec2{b.xy, b.yy};
    return {b.xx * u.x + b.xy * u.y, b.xx * v.x + b.xy * v.y, b.xy * v.x + b.yy * v.y};
}

class Touring {
  public:
    double length = 0, bound = 0;
    int steps = 0;
    std::vector<Vec2> x;

    Touring(Vec2 start, std::vector<Vec2> centres, std::vector<double> radii)
        : x(centres), start_(start), c_(std::move(centres)), r_(std::move(radii)), n_(c_.size()) {
        g_.resize(n_), move_.resize(n_), trial_.resize(n_), p_.resize(n_ + 1);
        diagonal_.resize(n_), link_.resize(n_);
    }

    // Until the length is within `gap` of its bound, or `most` Newton steps are done.
    bool solve(double gap, int most) {
        measure();
        double mu = 0;
        for (const double r : r_) mu = std::max(mu, r);
        mu = std::max(mu, length / double(n_));
        const double least = 1e-14 * (mu + length);
        while (true) {
            for (int k = 0; k < kCentring && steps < most; ++k)
                if (newton(mu) < kCentred) break;
            measure();
            if (length - bound <= gap) return true;
            if (steps >= most || mu <= least) return false;
            mu *= kShrink;
        }
    }

  private:
    static constexpr int kCentring = 30;       // Newton steps at one mu, at most
    static constexpr double kCentred = 0.3;    // decrement at which the next mu may come
    static constexpr double kShrink = 0.15;

    Vec2 start_;
    std::vector<Vec2> c_;
    std::vector<double> r_;
    size_t n_;
    std::vector<Vec2> g_, move_, trial_, p_;
    std::vector<Sym2> diagonal_, link_;  // Hessian: blocks (k, k), and (k, k+1) = -link_[k+1]

    Vec2 before(const std::vector<Vec2> &at, size_t k) const { return k ? at[k - 1] : start_; }

    // Value of the barrier problem over mu; infinite outside of a disc.
    double value(const std::vector<Vec2> &at, double mu) const {
        double sum = 0;
        for (size_t k = 0; k < n_; ++k) {
            const Vec2 d = at[k] - before(at, k), o = at[k] - c_[k];
            const double t = mu + std::sqrt(mu * mu + dot(d, d));
            const double room = (r_[k] - norm(o)) * (r_[k] + norm(o));
            if (!(room > 0)) return INFINITY;
            sum += t / mu - std::log(2 * mu * t) - std::log(room);
        }
        return sum;
    }

    // One damped Newton step; the decrement before it.
    double newton(double mu) {
        ++steps;
        for (size_t k = 0; k < n_; ++k) {
            const Vec2 d = x[k] - before(x, k), o = x[k] - c_[k];
            const double s = std::sqrt(mu * mu + dot(d, d)), t = mu + s;
            const double room = (r_[k] - norm(o)) * (r_[k] + norm(o));
            const Vec2 pull = (1 / (mu * t)) * d;
            link_[k] = spread(1 / (mu * t), -1 / (mu * t * t * s), d);
            g_[k] = pull + (2 / room) * o;
            diagonal_[k] = link_[k] + spread(2 / room, 4 / (room * room), o);
            if (k) {
                g_[k - 1] = g_[k - 1] - pull;
                diagonal_[k - 1] = diagonal_[k - 1] + link_[k];
            }
        }
        // Block elimination: H = L D L', D_k = A_k - B_k D_{k-1}^-1 B_k with B_k = link_[k].
        for (size_t k = 0; k < n_; ++k) {
            move_[k] = -1 * g_[k];
            if (k) {
                const Sym2 inv = diagonal_[k - 1];
                move_[k] = move_[k] + link_[k] * (inv * move_[k - 1]);
                diagonal_[k] = diagonal_[k] - congruent(link_[k], inv);
            }
            diagonal_[k] = inverse(diagonal_[k]);
        }
        for (size_t k = n_; k-- > 0;) {
            if (k + 1 < n_) move_[k] = move_[k] + link_[k + 1] * move_[k + 1];
            move_[k] = diagonal_[k] * move_[k];
        }
        double slope = 0;
        for (size_t k = 0; k < n_; ++k) slope += dot(g_[k], move_[k]);
        if (!(slope < 0)) return 0;  // rounding: as near as it gets
        const double now = value(x, mu);
        double share = 1;
        for (int half = 0; half < 60; ++half, share *= 0.5) {
            for (size_t k = 0; k < n_; ++k) trial_[k] = x[k] + share * move_[k];
            if (value(trial_, mu) <= now + 0.1 * share * slope) {
                x.swap(trial_);
                break;
            }
        }
        mu_ = mu;
        return std::sqrt(-slope);
    }

    void measure() {
        length = 0;
        for (size_t k = 0; k < n_; ++k) {
            const Vec2 d = x[k] - before(x, k);
            length += norm(d);
            p_[k] = mu_ > 0 ? (1 / (mu_ + std::sqrt(mu_ * mu_ + dot(d, d)))) * d : Vec2{};
        }
        p_[n_] = {};
        double sum = -dot(p_[0], start_);
        for (size_t k = 0; k < n_; ++k) {
            const Vec2 q = p_[k] - p_[k + 1];
            sum += dot(c_[k], q) - r_[k] * norm(q);
        }
        bound = std::max(bound, sum);
    }

    double mu_ = 0;
};

}  // namespace trackfield
