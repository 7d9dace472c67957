// One sensor's message about a pass, taken back to what it stands for: a record of samples.
//
// A message is the best fit of a profile to a record. Its likelihood is no Gaussian about it, least of all where the
// sensor heard little; but the fusion center knows when the sensor sampled and how loud its noise is, so it lays the
// told profile over that record and asks how well another profile explains it: half the deviance is
//   no fading   sum (told - a)^2 / (2 sigma^2)
//   Rayleigh    sum s_told / s - 1 - log(s_told / s),   s = sigma^2 + a^2,
// whose curvature at the message is the sensor's Fisher matrix, and which stays right far away from it. As printed, Berger
// (18), it is a Gaussian about the message with the Fisher matrix told.
#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

namespace trackfield::passes {

constexpr double LEAST = 1e-16;  // of w: no target goes through a sensor

// The squared distance over Q = P^(1/alpha) as a quadratic in time: a = w(t)^(-alpha/2), w = c0 + c1 t + c2 t^2.
struct Quadratic {
    double c0, c1, c2;
    double at(double t) const { return std::max(LEAST, c0 + t * (c1 + t * c2)); }
};

// Half the deviance, its gradient and its Fisher matrix in (c0, c1, c2, alpha); without alpha where that is known.
struct Evidence {
    double half = 0.0;
    double g[4] = {};
    double F[4][4] = {};
};

inline double amplitude(double w, double alpha) {
    return alpha == 1.0 ? 1.0 / std::sqrt(w) : alpha == 2.0 ? 1.0 / w : std::pow(w, -0.5 * alpha);
}

// c of a profile a_max (1 + c tau^2)^(-alpha/2) that has lost half its amplitude at tau = 1.
inline double steepness(double alpha) { return std::exp2(2.0 / alpha) - 1.0; }

class Message {
   public:
    double x, y;            // where the sensor stands
    double a, t, width;     // what it said
    double sigma, clock;    // its noise; standard deviation of its clock's error
    bool heard;             // false: "nothing there", a message like any other

    // `psi` is a_max, t_max, width; `record` first time, step, count, sigma, clock, fading, saturation; `fisher`
    // null or (3, 3) of psi; `rounding` null or the covariance (3, 3) of what rounding did to psi.
    Message(double x, double y, const double *psi, const double *record, const double *fisher, const double *rounding, double alpha)
        : x(x), y(y), a(psi[0]), t(psi[1]), width(psi[2]), sigma(record[3]), clock(record[4]), heard(a > 0.0 && width > 0.0),
          printed_(fisher != nullptr), fading_(record[5] != 0.0) {
        if (printed_) {
            std::copy(fisher, fisher + 9, &fisher_[0][0]);
            loudness_ = fisher[0] * a * a;
            return;
        }
        // narrower than any two samples can tell: the same flanks
        if (const double narrow = 0.01 * record[1]; heard && width < narrow) a *= std::pow(width / narrow, alpha), width = narrow;
        lay(record, alpha);
        if (rounding != nullptr && heard && !fading_) blur(rounding, alpha);
        loudness_ = 2.0 * half({1e300, 0.0, 0.0}, alpha);
    }

    // Deviance of no target at all.
    double loudness() const { return loudness_; }

    // What the message says of w itself.
    Quadratic own(double alpha) const {
        const double per = std::pow(a, -2.0 / alpha), c = steepness(alpha) / (width * width);
        return {per * (1.0 + c * t * t), -2.0 * per * c * t, per * c};
    }

    double half(const Quadratic &q, double alpha) const {
        if (printed_) return as_printed(q, alpha, false).half;
        double sum = 0.0;
        const size_t n = count_;
        if (fading_) {
            for (size_t i = 0; i < n; ++i) {
                const double a_i = amplitude(q.at(times_[i]), alpha), ratio = told_[i] / (sigma * sigma + a_i * a_i);
                sum += ratio - 1.0 - std::log(ratio);
            }
            return sum;
        }
        if (blurred_) return summed<false, false>(q, alpha).half;
        if (alpha == 1.0) return 0.5 * lanes(q) / (sigma * sigma);
        for (size_t i = 0; i < n; ++i) {
            const double r = told_[i] - amplitude(q.at(times_[i]), alpha);
            sum += r * r;
        }
        return 0.5 * sum / (sigma * sigma);
    }

    // `free`: the exponent is a state, and the message is read with it: width and a_max stay what they are.
    Evidence evidence(const Quadratic &q, double alpha, bool free) const {
        if (printed_) return as_printed(q, alpha, free);
        if (free) return fading_ ? summed<true, true>(q, alpha) : summed<false, true>(q, alpha);
        if (fading_) return summed<true, false>(q, alpha);
        return alpha == 1.0 && !blurred_ ? in_free_space(q) : summed<false, false>(q, alpha);
    }

   private:
    static constexpr size_t LANES = 4;  // sums side by side, which a compiler turns into vector instructions

    // Squared residuals, alpha 1: the loop that ranks starts.
    double lanes(const Quadratic &q) const {
        double sum[LANES] = {};
        const size_t n = count_, whole = n - n % LANES;
        for (size_t i = 0; i < whole; i += LANES)
            for (size_t j = 0; j < LANES; ++j) {
                const double r = told_[i + j] - 1.0 / std::sqrt(q.at(times_[i + j]));
                sum[j] += r * r;
            }
        for (size_t i = whole; i < n; ++i) {
            const double r = told_[i] - 1.0 / std::sqrt(q.at(times_[i]));
            sum[0] += r * r;
        }
        return sum[0] + sum[1] + sum[2] + sum[3];
    }

    template <bool Fading, bool Free>
    Evidence summed(const Quadratic &q, double alpha) const {
        Evidence e;
        double moment[5] = {}, u[3] = {}, M[3][4] = {};  // of a blurred message: its slopes times residuals, times ours
        const double noise = sigma * sigma, c = steepness(alpha);
        const double dc = -2.0 * std::numbers::ln2 / (alpha * alpha) * (c + 1.0);
        for (size_t i = 0; i < count_; ++i) {
            const double s = times_[i], w = q.at(s), a_i = amplitude(w, alpha);
            double told = told_[i], told_slope = 0.0;
            if (Free && heard) {
                const double z2 = (s - t) * (s - t) / (width * width), p = 1.0 + c * z2, b = a * std::pow(p, -0.5 * alpha);
                told_slope = -b * (0.5 * std::log(p) + 0.5 * alpha * z2 * dc / p);
                told = Fading ? noise + b * b : b;
                if (Fading) told_slope *= 2.0 * b;
            }
            double push, grip, lift = 1.0;  // slope and curvature in the residual's unit; that unit per amplitude
            if (Fading) {
                const double v = noise + a_i * a_i, ratio = told / v;
                e.half += ratio - 1.0 - std::log(ratio);
                lift = 2.0 * a_i, push = (1.0 - ratio) / v, grip = 1.0 / (v * v);
            } else {
                const double r = told - a_i;
                e.half += 0.5 * r * r / noise;
                push = -r / noise, grip = 1.0 / noise;
            }
            const double d = -0.5 * alpha * a_i / w * lift;
            add(e, moment, s, push * d, grip * d * d);
            if (!Fading && blurred_)
                for (int j = 0; j < 3; ++j) {
                    const double gd = slopes_[i][j] * d;
                    u[j] += slopes_[i][j] * (told - a_i);
                    M[j][0] += gd, M[j][1] += gd * s, M[j][2] += gd * s * s;
                    if (Free) M[j][3] += slopes_[i][j] * (-0.5 * a_i * std::log(w) - told_slope);
                }
            if (Free) {
                const double b = -0.5 * a_i * std::log(w) * lift - told_slope, db = grip * d * b;
                e.g[3] += push * b, e.F[3][3] += grip * b * b;
                e.F[0][3] += db, e.F[1][3] += db * s, e.F[2][3] += db * s * s;
            }
        }
        filled(e, moment, 1.0);
        return !Fading && blurred_ ? forgiven(e, u, M, Free ? 4 : 3) : e;
    }

    // The case that counts: alpha 1, no fading.
    Evidence in_free_space(const Quadratic &q) const {
        Evidence e;
        double moment[5] = {};
        constexpr size_t CHUNK = 64;  // the roots first, which vectorise; then the sums
        double roots[CHUNK];
        for (size_t from = 0; from < count_; from += CHUNK) {
            const size_t n = std::min(CHUNK, count_ - from);
            const double *s = times_.data() + from, *z = told_.data() + from;
            for (size_t i = 0; i < n; ++i) roots[i] = 1.0 / std::sqrt(q.at(s[i]));
            for (size_t i = 0; i < n; ++i) {
                const double a_i = roots[i], r = z[i] - a_i, d = -0.5 * a_i * a_i * a_i;
                e.half += r * r;
                add(e, moment, s[i], -r * d, d * d);
            }
        }
        e.half *= 0.5;
        return filled(e, moment, 1.0 / (sigma * sigma));
    }

    static void add(Evidence &e, double *moment, double s, double dg, double df) {
        const double s2 = s * s;
        e.g[0] += dg, e.g[1] += dg * s, e.g[2] += dg * s2;
        moment[0] += df, moment[1] += df * s, moment[2] += df * s2, moment[3] += df * s2 * s, moment[4] += df * s2 * s2;
    }

    // Woodbury: the residuals' covariance is sigma^2 I + G A G', with A that of rounding and G the told profile's slopes.
    Evidence forgiven(Evidence e, const double *u, const double (*M)[4], int n) const {
        const double weight = 1.0 / (sigma * sigma);
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) {
                const double k = weight * forgiving_[i][j];
                e.half -= 0.5 * k * u[i] * u[j];
                for (int a = 0; a < n; ++a) {
                    e.g[a] += k * u[i] * M[j][a];
                    for (int b = 0; b < n; ++b) e.F[a][b] -= k * M[i][a] * M[j][b];
                }
            }
        return e;
    }

    // (sigma^2 A^-1 + G' G)^-1 = A (sigma^2 I + G' G A)^-1, which wants no inverse of A.
    void blur(const double *rounding, double alpha) {
        const double c = steepness(alpha);
        double GG[3][3] = {}, R[3][3] = {};
        slopes_.resize(count_);
        for (size_t i = 0; i < count_; ++i) {
            const double z = (times_[i] - t) / width, p = 1.0 + c * z * z, per = alpha * c * told_[i] * z / (p * width);
            slopes_[i] = {told_[i] / a, per, per * z};
            for (int j = 0; j < 3; ++j)
                for (int k = 0; k < 3; ++k) GG[j][k] += slopes_[i][j] * slopes_[i][k];
        }
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) {
                R[i][j] = i == j ? sigma * sigma : 0.0;
                for (int k = 0; k < 3; ++k) R[i][j] += GG[i][k] * rounding[3 * k + j];
            }
        const auto minor = [&](int i, int j) {
            const int a = (i + 1) % 3, b = (i + 2) % 3, d = (j + 1) % 3, f = (j + 2) % 3;
            return R[a][d] * R[b][f] - R[a][f] * R[b][d];
        };
        const double det = R[0][0] * minor(0, 0) + R[0][1] * minor(0, 1) + R[0][2] * minor(0, 2);
        if (!(det > 0.0)) return;
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j)
                for (int k = 0; k < 3; ++k) forgiving_[i][j] += rounding[3 * i + k] * minor(j, k) / det;
        blurred_ = true;
    }

    static Evidence filled(Evidence &e, const double *moment, double weight) {
        e.half *= weight;
        for (double &g : e.g) g *= weight;
        for (int j = 0; j < 3; ++j) {
            for (int k = 0; k < 3; ++k) e.F[j][k] = weight * moment[j + k];
            e.F[3][j] = e.F[j][3];
        }
        return e;
    }

    // Berger (18): psi = (A, t, width) of w, against the message, with its Fisher matrix.
    Evidence as_printed(const Quadratic &q, double alpha, bool free) const {
        Evidence e;
        const double c = steepness(alpha), c2 = std::max(q.c2, LEAST), tm = -0.5 * q.c1 / c2, d2 = std::max(LEAST, q.c0 + 0.5 * q.c1 * tm);
        const double A = amplitude(d2, alpha), W = std::sqrt(c * d2 / c2);
        const double r[3] = {A - a, tm - t, W - width};
        const double per = -0.5 * alpha * A / d2, dc = -2.0 * std::numbers::ln2 / (alpha * alpha) * (c + 1.0);
        // slopes in (c0, c1, c2, alpha); d2 has slopes 1, tm, tm^2
        const double G[3][4] = {{per, per * tm, per * tm * tm, -0.5 * A * std::log(d2)},
                                {0.0, -0.5 / c2, -tm / c2, 0.0},
                                {0.5 * W / d2, 0.5 * W * tm / d2, 0.5 * W * (tm * tm / d2 - 1.0 / c2), 0.5 * W * dc / c}};
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) {
                const double f = fisher_[i][j];
                e.half += 0.5 * f * r[i] * r[j];
                for (int k = 0; k < (free ? 4 : 3); ++k) {
                    e.g[k] += f * r[i] * G[j][k];
                    for (int l = 0; l < (free ? 4 : 3); ++l) e.F[k][l] += f * G[i][k] * G[j][l];
                }
            }
        return e;
    }

    // The told profile over its record, without the samples that stood at the saturation: they say little.
    void lay(const double *record, double alpha) {
        const double c = steepness(alpha);
        times_.reserve(size_t(record[2])), told_.reserve(size_t(record[2]));
        for (size_t i = 0; i < size_t(record[2]); ++i) {
            const double s = record[0] + record[1] * double(i), z = heard ? (s - t) / width : 0.0;
            const double b = heard ? a * amplitude(1.0 + c * z * z, alpha) : 0.0;
            if (b < record[6]) times_.push_back(s), told_.push_back(fading_ ? sigma * sigma + b * b : b);
        }
        count_ = times_.size();
    }

    bool printed_, fading_, blurred_ = false;
    double fisher_[3][3] = {}, forgiving_[3][3] = {};
    std::vector<std::array<double, 3>> slopes_;  // of the told profile, where that is blurred
    size_t count_ = 0;
    std::vector<double> times_, told_;  // told amplitudes, or powers sigma^2 + a^2 with fading
    double loudness_ = 0.0;
};

}  // namespace trackfield::passes
