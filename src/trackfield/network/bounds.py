"""What the values of a site's keys may be, and how to say it."""

from __future__ import annotations

import math
from typing import NamedTuple


class Bound(NamedTuple):
    """What a value must be, in the words of pydantic, and what to tell who wrote another one."""

    limits: dict[str, float]
    expected: str


_POSITIVE = Bound({"gt": 0.0}, "a number above 0")
_NOT_NEGATIVE = Bound({"ge": 0.0}, "a finite number, 0 or more")
_PROBABILITY = Bound({"ge": 0.0, "le": 1.0}, "a probability from 0 to 1")
_CHANCE = Bound({"gt": 0.0, "le": 1.0}, "a probability above 0, up to 1")
_DOUBT = Bound({"ge": 0.0, "lt": 1.0}, "a probability from 0 to below 1")
FARTHEST_M = 1e9  # of a place from the origin: beyond, squares and differences lose all sense
_PLACE = Bound({"ge": -FARTHEST_M, "le": FARTHEST_M}, "a finite number of metres, from -1e9 to 1e9")
_BOUNDS = {
    "x_m": _PLACE,
    "y_m": _PLACE,
    "z_m": _PLACE,
    "height_m": _PLACE,
    "scale": Bound(
        {"gt": -0.5, "lt": 0.5},
        "a number between -0.5 and 0.5: what is added to a factor of 1 "
        "(a factor of 1.02 is written 0.02)",
    ),
    "lat": Bound({"ge": -90.0, "le": 90.0}, "degrees from -90 to 90"),
    "lon": Bound({"ge": -180.0, "le": 360.0}, "degrees from -180 to 360"),
    "heading_deg": Bound({"ge": -360.0, "le": 360.0}, "degrees from -360 to 360"),
    "width_deg": Bound({"gt": 0.0, "le": 360.0}, "degrees above 0, up to 360"),
    "polygon": Bound({}, "at least three corners [x, y] in metres from -1e9 to 1e9"),
    "region": Bound(
        {"min_length": 4, "max_length": 4},
        "[x_min, y_min, x_max, y_max] in metres from -1e9 to 1e9, min below max",
    ),
    "amplitude": _POSITIVE,
    "falloff": _POSITIVE,
    "exponent": _POSITIVE,
    "sigma": _POSITIVE,
    "sigma_rad": _POSITIVE,
    "sigma_rad_s": _POSITIVE,
    "sigma_db": _POSITIVE,
    "threshold": _NOT_NEGATIVE,
    "threshold_rad_s": _NOT_NEGATIVE,
    "power_dbm": Bound({"ge": -200.0, "le": 100.0}, "a strength in dBm, -200 to 100"),
    "min_dbm": Bound({"ge": -200.0, "le": 100.0}, "a strength in dBm, -200 to 100"),
    "shadow_db": _NOT_NEGATIVE,
    "shadow_m": _POSITIVE,
    "fading_db": _NOT_NEGATIVE,
    "p_blocked": _DOUBT,
    "blocked_db": _NOT_NEGATIVE,
    "burst_s": _NOT_NEGATIVE,
    "p_outlier": _DOUBT,
    "outlier_db": _POSITIVE,
    "near_m": _POSITIVE,
    "saturation": _POSITIVE,
    "sample_s": _POSITIVE,
    "record_s": _POSITIVE,
    "bits": Bound({"ge": 2, "le": 17}, "a whole number from 2 to 17"),
    "bias_rad": Bound({"ge": -math.pi, "le": math.pi}, "an angle in radians, -pi to pi"),
    "radius_m": _POSITIVE,
    "edge_m": _NOT_NEGATIVE,
    "p_detection": _CHANCE,
    "p_false": _DOUBT,
    "p_loss": _PROBABILITY,
    "p_delay": _PROBABILITY,
    "p_garbled": _PROBABILITY,
    "hop_m": _POSITIVE,
    "delay_step_s": _POSITIVE,
    "reports.sigma_m": _POSITIVE,
    "false_per_scan": _NOT_NEGATIVE,
    "step_s": _POSITIVE,
    "max_range_m": _POSITIVE,
    "correlation_length_m": _POSITIVE,
    "max_speed_m_s": _POSITIVE,
    "accel_sigma_m_s2": _POSITIVE,
    "velocity_sigma_m_s": _POSITIVE,
    "lifetime_s": _POSITIVE,
    "births_per_s": _POSITIVE,
    "initial_count": _NOT_NEGATIVE,
    "drop_s": _POSITIVE,
    "window_s": _NOT_NEGATIVE,
    "scheduling.sensors": Bound({"ge": 1, "le": 1000}, "a whole number from 1 to 1000"),
    "bound_m2": _POSITIVE,
    "interval_s": Bound({"gt": 0.0, "le": 1e6}, "a number above 0, up to 1e6"),
    "burst": Bound({"ge": 1, "le": 10_000}, "a whole number from 1 to 10000"),
    "reach_m": _POSITIVE,
    "near": Bound({"ge": 1.0}, "a factor of 1 or more"),
    "far": Bound({"ge": 1.0}, "a factor of 1 or more"),
    "alpha_deg": Bound({"ge": 0.0, "le": 180.0}, "degrees from 0 to 180"),
    "ahead_s": _NOT_NEGATIVE,
    "sweep_s": _NOT_NEGATIVE,
    "hysteresis": _NOT_NEGATIVE,
    "energy_weight": _NOT_NEGATIVE,
    "energy.battery_j": _POSITIVE,
    "comm_m": _POSITIVE,
    "sensing_m": _POSITIVE,
    "error_m": _NOT_NEGATIVE,
    "wheel_base_m": _POSITIVE,
    "max_steering_deg": Bound({"gt": 0.0, "lt": 90.0}, "degrees between 0 and 90"),
    "robot.radius_m": _NOT_NEGATIVE,
    "window_steps": Bound({"ge": 1, "le": 1000}, "a whole number from 1 to 1000"),
}


def bound(section: str, key: str) -> Bound | None:
    """Bound of a key: that of its section, that of its name, or that of all of its sort.

    Standard deviations and all that is spent are not negative.
    """
    return (
        _BOUNDS.get(f"{section}.{key}")
        or _BOUNDS.get(key)
        or (_NOT_NEGATIVE if "sigma" in key or section == "energy" else None)
    )
