// Belief of one target in the plane, N([p v], [A B; B' C]) in blocks of two, and what happens to it.
#pragma once

#include <algorithm>
#include <cmath>

namespace trackfield {

// Symmetric matrix of two rows: xx, xy, yy.
struct Sym2 {
    double xx = 0, xy = 0, yy = 0;
    double det() const { return xx * yy - xy * xy; }
    Sym2 inverse() const {
        const double d = 1 / det();
        return {yy * d, -xy * d, xx * d};
    }
    double form(double u, double v) const { return xx * u * u + 2 * xy * u * v + yy * v * v; }
    double trace() const { return xx + yy; }
};

inline Sym2 operator+(const Sym2 &a, const Sym2 &b) { return {a.xx + b.xx, a.xy + b.xy, a.yy + b.yy}; }

struct Plane {
    double x = 0, y = 0, vx = 0, vy = 0;
    Sym2 A, C;                                  // position, velocity
    double xu = 0, xw = 0, yu = 0, yw = 0;      // B: cov(x, vx), (x, vy), (y, vx), (y, vy)

    // x' = F x + G u over n steps of h, u ~ N(0, q^2) held within each: closed form of the sums, Oh (6).
    void predict(double h, double n, double q) {
        const double dt = h * n, q2 = q * q;
        x += dt * vx;
        y += dt * vy;
        A.xx += dt * (2 * xu + dt * C.xx) + q2 * h * h * h * h * (n * n * n / 3 - n / 12);
        A.yy += dt * (2 * yw + dt * C.yy) + q2 * h * h * h * h * (n * n * n / 3 - n / 12);
        A.xy += dt * (xw + yu + dt * C.xy);
        xu += dt * C.xx + q2 * h * h * h * n * n / 2;
        yw += dt * C.yy + q2 * h * h * h * n * n / 2;
        xw += dt * C.xy;
        yu += dt * C.xy;
        C.xx += q2 * h * h * n;
        C.yy += q2 * h * h * n;
    }

    // Condition on a report (zx, zy) ~ N(p, R).
    Plane updated(double zx, double zy, const Sym2 &R) const {
        const Sym2 W = (A + R).inverse();
        const double ex = zx - x, ey = zy - y;
        // Gains A W and B' W.
        const double axx = A.xx * W.xx + A.xy * W.xy, axy = A.xx * W.xy + A.xy * W.yy;
        const double ayx = A.xy * W.xx + A.yy * W.xy, ayy = A.xy * W.xy + A.yy * W.yy;
        const double ux = xu * W.xx + yu * W.xy, uy = xu * W.xy + yu * W.yy;
        const double wx = xw * W.xx + yw * W.xy, wy = xw * W.xy + yw * W.yy;
        Plane p;
        p.x = x + axx * ex + axy * ey;
        p.y = y + ayx * ex + ayy * ey;
        p.vx = vx + ux * ex + uy * ey;
        p.vy = vy + wx * ex + wy * ey;
        p.A = {axx * R.xx + axy * R.xy, axx * R.xy + axy * R.yy, ayx * R.xy + ayy * R.yy};  // A W R: no difference
        p.xu = xu - (axx * xu + axy * yu);
        p.xw = xw - (axx * xw + axy * yw);
        p.yu = yu - (ayx * xu + ayy * yu);
        p.yw = yw - (ayx * xw + ayy * yw);
        p.C = {C.xx - (ux * xu + uy * yu), C.xy - (ux * xw + uy * yw), C.yy - (wx * xw + wy * yw)};
        return p;
    }
};

// Moments of a mixture, gathered component by component around its first one.
class Moments {
  public:
    void add(const Plane &p, double w) {
        if (total_ == 0) base_ = p;
        total_ += w;
        const double d[4] = {p.x - base_.x, p.y - base_.y, p.vx - base_.vx, p.vy - base_.vy};
        for (int i = 0; i < 4; ++i) first_[i] += w * d[i];
        const double P[10] = {p.A.xx, p.A.xy, p.A.yy, p.xu, p.xw, p.yu, p.yw, p.C.xx, p.C.xy, p.C.yy};
        for (int k = 0; k < 10; ++k) second_[k] += w * (P[k] + d[kRow[k]] * d[kColumn[k]]);
    }

    double total() const { return total_; }

    Plane mixed() const {
        double m[4], P[10];
        for (int i = 0; i < 4; ++i) m[i] = first_[i] / total_;
        for (int k = 0; k < 10; ++k) P[k] = second_[k] / total_ - m[kRow[k]] * m[kColumn[k]];
        Plane p;
        p.x = base_.x + m[0];
        p.y = base_.y + m[1];
        p.vx = base_.vx + m[2];
        p.vy = base_.vy + m[3];
        p.A = {P[0], P[1], P[2]};
        p.xu = P[3];
        p.xw = P[4];
        p.yu = P[5];
        p.yw = P[6];
        p.C = {P[7], P[8], P[9]};
        return p;
    }

  private:
    static constexpr int kRow[10] = {0, 0, 1, 0, 0, 1, 1, 2, 2, 3};
    static constexpr int kColumn[10] = {0, 1, 1, 2, 3, 2, 3, 2, 3, 3};
    Plane base_;
    double total_ = 0, first_[4] = {}, second_[10] = {};
};

}  // namespace trackfield
