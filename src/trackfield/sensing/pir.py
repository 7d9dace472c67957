"""Waveforms of passive infrared sensors: walkers, noise, drift and warm air, to test front ends."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import scipy.signal

from trackfield.errors import InputError
from trackfield.types import Matrix, Vector

_signal = cast("Any", scipy.signal)  # its filters have no types


@dataclass(frozen=True, slots=True)
class PirWorld:
    """A sensor behind a lens, and what else it sees; volts about its rest.

    The lens cuts the view into zones of alternating sign, `zone_deg` wide: a walker who crosses
    them makes the signal swing, one who comes straight at the sensor hardly does. The swing is
    `swing_v` near by and falls by half at `half_m`, to a ninth at twice that. The element passes
    what changes at `band_hz`. Noise is white, `noise_v`; drift (sun, temperature) an
    Ornstein-Uhlenbeck process of `drift_v` over `drift_s`; `plumes_per_s` clouds of warm air pass,
    each a slow swell of up to `plume_v` for about `plume_s`.
    """

    swing_v: float = 1.0
    half_m: float = 5.0
    zone_deg: float = 12.0
    band_hz: tuple[float, float] = (0.1, 7.0)
    noise_v: float = 0.02
    drift_v: float = 0.1
    drift_s: float = 60.0
    plumes_per_s: float = 0.02
    plume_v: float = 0.3
    plume_s: float = 4.0


def simulate_pir(
    world: PirWorld, paths: Matrix, *, rate_hz: float, rng: np.random.Generator
) -> Vector:
    """Waveform (n,) [V] of a sensor at the origin, of k targets on `paths` (n, k, 2) [m].

    One row a sample at `rate_hz`; a target is not there while its position is NaN.
    """
    if paths.ndim != 3 or paths.shape[2] != 2 or not len(paths):
        raise InputError(f"paths: found shape {paths.shape}, expected (n, k, 2), n at least 1")
    if not (np.isfinite(rate_hz) and rate_hz > 2.0 * world.band_hz[1]):
        raise InputError(
            f"rate_hz: found {rate_hz:g}, expected more than {2.0 * world.band_hz[1]:g}, "
            "twice the element's band"
        )
    n = len(paths)
    sections = _signal.butter(1, world.band_hz, "bandpass", fs=rate_hz, output="sos")
    element = _signal.sosfilt(sections, _scene(world, paths).sum(axis=1))
    return np.asarray(
        element
        + _drift(world, n, rate_hz=rate_hz, rng=rng)
        + _plumes(world, n, rate_hz=rate_hz, rng=rng)
        + world.noise_v * rng.standard_normal(n),
        float,
    )


def _scene(world: PirWorld, paths: Matrix) -> Matrix:
    """Signal (n, k) [V] that falls onto the element of each target."""
    bearing = np.arctan2(paths[..., 1], paths[..., 0])
    distance = np.hypot(paths[..., 0], paths[..., 1])
    weight = world.swing_v / (1.0 + (distance / world.half_m) ** 3)
    swing = weight * np.sin(bearing * np.pi / np.deg2rad(world.zone_deg))
    return np.nan_to_num(swing)


def _drift(world: PirWorld, n: int, *, rate_hz: float, rng: np.random.Generator) -> Vector:
    keep = float(np.exp(-1.0 / (rate_hz * world.drift_s)))
    kicks = world.drift_v * np.sqrt(1.0 - keep**2) * rng.standard_normal(n)
    kicks[0] = world.drift_v * rng.standard_normal()
    return np.asarray(_signal.lfilter([1.0], [1.0, -keep], kicks), float)


def _plumes(world: PirWorld, n: int, *, rate_hz: float, rng: np.random.Generator) -> Vector:
    t = np.arange(n) / rate_hz
    swell = np.zeros(n)
    for start in rng.uniform(0.0, n / rate_hz, rng.poisson(world.plumes_per_s * n / rate_hz)):
        since = (t - start) / (world.plume_s * rng.uniform(0.5, 1.5))
        height = world.plume_v * rng.uniform(-1.0, 1.0)
        swell += np.where((since > 0.0) & (since < 1.0), height * np.sin(np.pi * since) ** 2, 0.0)
    return swell
