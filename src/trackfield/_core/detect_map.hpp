// Which sensors see a place: coverage of every sensor on a raster, cell by cell.
#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

namespace trackfield::detect {

struct Seen {
    int32_t sensor;
    double covered;  // share of the place that the sensor covers, 0 to 1
};

struct CoverageMap {
    double x_min = 0, y_min = 0, cell = 1;
    int rows = 1, columns = 1;
    std::vector<int32_t> start;  // (rows * columns + 1) into seen
    std::vector<Seen> seen;

    // -1 outside: a target that leaves the region is gone.
    int at(double x, double y) const {
        const double j = std::floor((x - x_min) / cell), i = std::floor((y - y_min) / cell);
        if (!(j >= 0 && i >= 0 && j < columns && i < rows)) return -1;
        return int(i) * columns + int(j);
    }
    int cells() const { return rows * columns; }
    double x_of(int cell_number) const { return x_min + (cell_number % columns + 0.5) * cell; }
    double y_of(int cell_number) const { return y_min + (cell_number / columns + 0.5) * cell; }
    const Seen *begin(int cell_number) const { return seen.data() + start[cell_number]; }
    const Seen *end(int cell_number) const { return seen.data() + start[cell_number + 1]; }
};

}  // namespace trackfield::detect
