// A field of signal-strength sensors, Oh (1): what sources at given places make each sensor expect.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace trackfield::signals {

constexpr double kNearest2 = 1e-12;   // squared distance below which there is no slope [m^2]
constexpr double kEdgeSigmas = 4.0;   // of the sensor's place, about the border of its range

// One number for all sensors, or one for each.
struct Column {
    const double *values = nullptr;
    size_t stride = 0;
    double operator[](size_t i) const { return values[i * stride]; }
};

struct Field {
    size_t n = 0;
    const double *places = nullptr;  // (n, 2) [m]
    const double *z = nullptr;       // NaN: the sensor did not speak
    Column amplitude, falloff, exponent, range, sigma, gain, placement, saturation;
    double factor_sigma = 0;  // of the logarithm of a source's strength; 0: all alike
    bool strongest_only = false;

    double x(size_t i) const { return places[2 * i]; }
    double y(size_t i) const { return places[2 * i + 1]; }
    bool spoke(size_t i) const { return !std::isnan(z[i]); }
    double reach(size_t i) const { return range[i] + kEdgeSigmas * placement[i]; }
};

struct Source {
    double x = 0, y = 0, log_factor = 0;
    int32_t leader = -1;  // the sensor that found it
};

// What a sensor hears: mean, slope in a common shift of the sources, variance of the border.
struct Signal {
    double h = 0, gx = 0, gy = 0, edge = 0;
};

inline double power(double r2, double exponent) {
    return exponent == 2.0 ? r2 : std::exp(0.5 * exponent * std::log(r2));
}

inline Signal signal_of(const Field &f, size_t i, const Source &s) {
    const double dx = s.x - f.x(i), dy = s.y - f.y(i);
    const double r2 = std::max(dx * dx + dy * dy, kNearest2), range = f.range[i], place = f.placement[i];
    Signal o;
    const double reach = range + kEdgeSigmas * place;
    if (r2 > reach * reach) return o;
    const double a = f.amplitude[i] * (s.log_factor == 0.0 ? 1.0 : std::exp(s.log_factor));
    if (r2 <= range * range) {
        const double q = f.falloff[i] * power(r2, f.exponent[i]);
        o.h = a / (1.0 + q);
        const double slope = -o.h * f.exponent[i] * q / (r2 * (1.0 + q));
        o.gx = slope * dx;
        o.gy = slope * dy;
    }
    if (place > 0.0) {
        const double off = std::fabs(std::sqrt(r2) - range) / place;
        if (off < kEdgeSigmas) {
            const double step = a / (1.0 + f.falloff[i] * power(range * range, f.exponent[i]));
            o.edge = step * step * 0.5 * std::erfc(off * 0.7071067811865476);
        }
    }
    return o;
}

inline void add(const Field &f, Signal &sum, const Signal &one) {
    if (!f.strongest_only) {
        sum.h += one.h;
        sum.gx += one.gx;
        sum.gy += one.gy;
    } else if (one.h > sum.h) {
        sum.h = one.h;
        sum.gx = one.gx;
        sum.gy = one.gy;
    }
    sum.edge += one.edge;
}

inline double variance_of(const Field &f, size_t i, const Signal &s) {
    const double sigma = f.sigma[i], gain = f.gain[i] * s.h, place = f.placement[i];
    return sigma * sigma + gain * gain + place * place * (s.gx * s.gx + s.gy * s.gy) + s.edge;
}

// Reading less mean; a saturated reading that more than the limit is expected of says nothing.
inline double residual_of(const Field &f, size_t i, const Signal &s) {
    const double r = f.z[i] - s.h;
    return f.z[i] >= f.saturation[i] && r < 0.0 ? 0.0 : r;
}

// Square cells over the bounding box of the field; a place outside belongs to the nearest cell.
class Cells {
   public:
    int columns, rows;

    Cells(const Field &f, double width) {
        double x1 = -1e300, y1 = -1e300;
        x0 = y0 = 1e300;
        for (size_t i = 0; i < f.n; ++i) {
            x0 = std::min(x0, f.x(i)), x1 = std::max(x1, f.x(i));
            y0 = std::min(y0, f.y(i)), y1 = std::max(y1, f.y(i));
        }
        const double w = std::max(x1 - x0, 0.0), h = std::max(y1 - y0, 0.0);
        side = std::clamp(width, 1e-9, 1e9);
        while ((w / side + 1) * (h / side + 1) > double(f.n) + 4) side *= 1.5;
        columns = int(w / side) + 1;
        rows = int(h / side) + 1;
    }
    size_t size() const { return size_t(columns) * rows; }
    int column(double x) const { return int(std::clamp((x - x0) / side, 0.0, double(columns - 1))); }
    int row(double y) const { return int(std::clamp((y - y0) / side, 0.0, double(rows - 1))); }
    size_t of(double x, double y) const { return size_t(row(y)) * columns + column(x); }

   private:
    double x0, y0, side;
};

// The sensors that spoke, cell after cell.
class SensorIndex {
   public:
    SensorIndex(const Field &field, double width) : f(field), cells(field, width), first(cells.size() + 1, 0) {
        std::vector<int32_t> cell(f.n, -1);
        for (size_t i = 0; i < f.n; ++i)
            if (f.spoke(i)) ++first[size_t(cell[i] = int32_t(cells.of(f.x(i), f.y(i)))) + 1];
        for (size_t c = 0; c < cells.size(); ++c) first[c + 1] += first[c];
        ids.resize(first.back());
        std::vector<int32_t> next(first.begin(), first.end() - 1);
        for (size_t i = 0; i < f.n; ++i)
            if (cell[i] >= 0) ids[next[cell[i]]++] = int32_t(i);
    }
    template <class Visit>
    void within(double x, double y, double radius, Visit visit) const {
        const int c0 = cells.column(x - radius), c1 = cells.column(x + radius), r1 = cells.row(y + radius);
        for (int r = cells.row(y - radius); r <= r1; ++r) {
            const size_t row = size_t(r) * cells.columns;
            for (int32_t k = first[row + c0]; k < first[row + c1 + 1]; ++k) {
                const int32_t i = ids[k];
                const double dx = f.x(i) - x, dy = f.y(i) - y;
                if (dx * dx + dy * dy <= radius * radius) visit(i);
            }
        }
    }

   private:
    const Field &f;
    Cells cells;
    std::vector<int32_t> first, ids;
};

// Sources, which come, move and go.
class SourceIndex {
   public:
    SourceIndex(const Field &f, double width) : cells(f, width), at(cells.size()) {}
    void insert(int32_t id, const Source &s) { at[cells.of(s.x, s.y)].push_back(id); }
    void remove(int32_t id, const Source &s) {
        auto &ids = at[cells.of(s.x, s.y)];
        ids.erase(std::find(ids.begin(), ids.end(), id));
    }
    // Ids in all cells that a disc touches: the caller looks at the distance.
    template <class Visit>
    void near(double x, double y, double radius, Visit visit) const {
        const int c0 = cells.column(x - radius), c1 = cells.column(x + radius), r1 = cells.row(y + radius);
        for (int r = cells.row(y - radius); r <= r1; ++r)
            for (int c = c0; c <= c1; ++c)
                for (int32_t id : at[size_t(r) * cells.columns + c]) visit(id);
    }

   private:
    Cells cells;
    std::vector<std::vector<int32_t>> at;
};

}  // namespace trackfield::signals
