// What is settled before the first reading: sensors, motion, what is learned, the order of the state.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

namespace trackfield {

constexpr double kTwoPi = 6.283185307179586;
constexpr int kMaxModes = 4;
constexpr double kLeastSigma = 1e-3;  // of a range [m]: less would drown in rounding
constexpr double kLongest = 1e7;      // a number beyond this is no range at all [m]

struct SensorModel {
    double x = 0, y = 0, z = 0;
    double bias = 0, scale = 0;          // means of n and gamma, Wang (2)
    double variance = 0;                 // of n [m^2]
    double scale_variance = 0;           // of gamma
    double max_range = 1e300;
    double correlated_sigma = 0, correlation_length = 1;
    double bias_sigma = 0;
    bool learn = true;
    double placement_variance = 0;  // of what ranges cannot see: antenna against tracked point [m^2]
    double longest = 1e300;         // a reading beyond this is no range of this sensor [m]
};

struct Mode {
    double accel_density = 0;  // white acceleration [m^2/s^3]
    bool turns = false;
    double switch_rate = 0;    // of leaving the mode [1/s]
};

// What is settled before the first reading; Python gives every number (filtering/range_tracker.py).
struct Settings {
    int dimensions = 2;
    bool height_open = false;
    double height = 0, height_sigma = 0, height_time = 0;
    double scale_sigma = 0, common_bias_sigma = 0;
    int modes = 0;
    Mode mode[kMaxModes];
    double velocity_time = 0;         // velocity forgets itself [s]
    double outage_velocity_time = 0;  // the same in what a step lasts beyond turn_max_step [s]
    double velocity_sigma = 0;        // of a start, per axis [m/s]
    double turn_sigma = 0, turn_time = 0, turn_max_step = 0, turn_step = 0;
    bool robust = true;
    double p_nlos = 0, nlos_sigmas = 0, p_outlier = 0, outlier_sigmas = 0;
    double shares_weight = 0, memory_shares = 0;  // prior and memory of the shares, in readings
    int iterations = 0;
    double noise_floor = 0;                       // [m]
    double memory_own = 0, memory_pool = 0;       // of learned noise, in readings
    double pool_weight = 0, prior_weight = 0;     // of the pool for a sensor, of the model for the pool
    double worst_factor = 0;                      // of learned variance over the model's
    int slots = 0;
    bool slot_bias = false, slot_correlated = false;
    double slot_idle = 0;  // a slot silent for this long may be given to another sensor [s]
    double drop_time = 0;
    double lag_time = 0;
    int lag_steps = 0;
    double every = 0;
    double window = 0;
    int start_readings = 0, start_sensors = 0;
    double start_span = 0;  // readings older than this do not start a track [s]
    int restart_window = 0;
};

struct Layout {
    int D = 2, height = -1, turn = -1, scale = -1, bias = -1, slot0 = 0, per_slot = 0, n = 4;
    int slot_bias = -1, slot_correlated = -1;  // offsets inside a slot

    explicit Layout(const Settings &s) : D(s.dimensions) {
        n = 2 * D;
        if (s.height_open) height = n++;
        for (int j = 0; j < s.modes; ++j)
            if (s.mode[j].turns && turn < 0) turn = n++;
        if (s.scale_sigma > 0) scale = n++;
        if (s.common_bias_sigma > 0) bias = n++;
        slot0 = n;
        if (s.slot_bias) slot_bias = per_slot++;
        if (s.slot_correlated) slot_correlated = per_slot++;
        n += per_slot * s.slots;
    }
};

}  // namespace trackfield
