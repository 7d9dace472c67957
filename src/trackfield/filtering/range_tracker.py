"""The default tracker of tagged targets from ranges: what it believes before the first reading.

Iterated EKF under an IMM of straight, turning and manoeuvring motion; a mixture of line-of-sight,
late and outlying readings whose shares and noise are learned on line; errors of each sensor that
fade with the distance travelled; bias and scale estimated along where the site leaves them open.
The arithmetic is compiled (`trackfield._core`); every number it starts from stands here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackfield._core._kernels import RangeBank
from trackfield.network.site import Site, Target, range_models
from trackfield.sensing.range import RangeModel
from trackfield.types import Matrix

_SLOTS = 12  # sensors whose own errors are followed at a time
_CARRIED_HEIGHT_M = 1.0  # of a tag of which nothing is told: worn or carried
_CARRIED_SIGMA_M = 0.5


class Mode(NamedTuple):
    """One way to move: white acceleration of density q [m^2/s^3], left at `switch_rate` [1/s]."""

    accel_density: float
    turns: bool
    switch_rate: float


STRAIGHT = Mode(0.0003, turns=False, switch_rate=0.1)
TURNING = Mode(0.05, turns=True, switch_rate=0.2)
MANOEUVRING = Mode(0.5, turns=True, switch_rate=0.5)


class Output(NamedTuple):
    """What rows are asked for: how late, how often."""

    lag_s: float = 0.0
    lag_steps: int = 0
    every_s: float = 0.0


class Robustness(NamedTuple):
    """Shares and widths of late (NLOS) and outlying readings, in sigmas of the white noise.

    The shares are priors worth `shares_weight` readings, learned with a memory of
    `memory_shares` readings. Late readings are N(5 sigma, S + (5 sigma)^2), outlying ones
    N(0, S + (30 sigma)^2).
    """

    p_nlos: float = 0.10
    nlos_sigmas: float = 5.0
    p_outlier: float = 0.02
    outlier_sigmas: float = 30.0
    shares_weight: float = 20.0
    memory_shares: float = 300.0


def modes(target: Target) -> tuple[Mode, ...]:
    """Ways to move of a target: one for "cv", three for "imm".

    `accel_sigma_m_s2` is the acceleration that lasts a second: density q = accel_sigma^2 * 1 s.
    """
    density = None if target.accel_sigma_m_s2 is None else target.accel_sigma_m_s2**2
    if target.motion == "cv":
        alone = MANOEUVRING.accel_density if density is None else density
        return (Mode(alone, turns=False, switch_rate=0.0),)
    if density is None:
        return (STRAIGHT, TURNING, MANOEUVRING)
    return (
        STRAIGHT._replace(accel_density=min(STRAIGHT.accel_density, density)),
        TURNING._replace(accel_density=min(TURNING.accel_density, density)),
        MANOEUVRING._replace(accel_density=density),
    )


def height_prior(site: Site) -> tuple[float, float]:
    """Height of targets above the frame's origin in a 2-D site, mean and sigma [m].

    Sigma is 0 where the height is told or does not matter (sensors without heights, or all in the
    plane z = 0).
    """
    if site.target.height_m is not None:
        return site.target.height_m, 0.0
    z = site.positions[:, 2]
    z = z[np.isfinite(z)]
    if site.target.dimensions == 3 or z.size == 0 or not np.any(z):
        return 0.0, 0.0
    mean = min(max(_CARRIED_HEIGHT_M, float(z.min()) - 2.0), float(z.max()))
    return mean, _CARRIED_SIGMA_M


def create(site: Site, output: Output, robustness: Robustness | None = Robustness()) -> RangeBank:  # noqa: B008 - an immutable value
    """Tracker of any number of targets with the site's models; None: Gaussian noise, not robust."""
    every = [range_models(site), *(range_models(site, target) for target in site.target_models)]
    models = [model for column in every for model in column]
    height, height_sigma = height_prior(site)
    open_calibration = site.tracker.self_calibration
    own_bias = open_calibration and any(m.bias_sigma_m > 0 for m in models)
    own_errors = any(m.correlated_sigma_m > 0 for m in models)
    followed = own_bias or own_errors or any(m.learn_noise for m in models)
    robust = robustness or Robustness()
    settings: dict[str, object] = {
        "dimensions": site.target.dimensions,
        "height_open": height_sigma > 0,
        "height": height,
        "height_sigma": height_sigma,
        "height_time": 10.0,
        "scale_sigma": max(m.scale_sigma for m in models) * open_calibration,
        "common_bias_sigma": max(m.common_bias_sigma_m for m in models) * open_calibration,
        "velocity_time": 100.0,
        "outage_velocity_time": 10.0,
        "velocity_sigma": min(1.5, site.target.max_speed_m_s),
        "turn_sigma": 0.25,
        "turn_time": 2.5,
        "turn_max_step": 1.0,
        "turn_step": 0.5,
        "robust": robustness is not None,
        **robust._asdict(),
        "iterations": 3,
        "noise_floor": 0.02,
        "memory_own": 20.0,
        "memory_pool": 300.0,
        "pool_weight": 10.0,
        "prior_weight": 10.0,
        "worst_factor": 100.0,
        "slots": min(len(site.sensor_ids), _SLOTS) if followed else 0,
        "slot_bias": own_bias,
        "slot_correlated": own_errors,
        "slot_idle": 5.0,
        "drop_time": site.tracker.drop_s,
        "window": site.tracker.window_s,
        "lag_time": output.lag_s,
        "lag_steps": output.lag_steps,
        "every": output.every_s,
        "start_readings": 6,
        "start_sensors": min(4, len(site.sensor_ids)),
        "start_span": 4.0,
        "restart_window": 12,
        "modes": [mode._asdict() for mode in modes(site.target)],
    }
    bank = RangeBank(settings, _columns(site.positions, every[0], height))
    for column in every[1:]:
        bank.add_variant(_columns(site.positions, column, height))
    return bank


def _columns(positions: Matrix, models: Sequence[RangeModel], height: float) -> Matrix:
    """Table of sensors as the kernel reads it, one row a sensor."""
    table = np.empty((len(models), 13))
    table[:, :3] = positions
    # A sensor without a height stands in the targets' plane.
    table[:, 2] = np.where(np.isfinite(positions[:, 2]), positions[:, 2], height)
    table[:, 3:] = [
        (
            m.bias_m,
            m.scale,
            m.sigma_m**2,
            m.sigma_scale**2,
            min(m.max_range_m, 1e300),
            m.correlated_sigma_m,
            m.correlation_length_m,
            m.bias_sigma_m,
            m.learn_noise,
            m.placement_sigma_m**2,
        )
        for m in models
    ]
    return np.ascontiguousarray(table)
