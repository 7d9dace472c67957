"""Starts all over for the likelihood of all samples, so that no other trajectory is overlooked."""

from __future__ import annotations

import math

import numpy as np

from trackfield.localization.pass_raw import RawPass, fits
from trackfield.types import Matrix, Vector

HEADINGS = 12
OFFSETS = (-1.2, -0.6, 0.0, 0.6, 1.2)  # of the way from the middle of the sensors [radii]
SPEEDS = (0.5, 1.0, 2.0)  # times the field's diameter a pass
_MOST = 300  # samples by which a start is judged
_LIKELY = 40.0  # log-likelihood by which a start, a few steps on, may be worse than the best
_FAR = 1e8  # a place or speed beyond it is no start


def spread_starts(given: RawPass) -> Matrix:
    """Trajectories (b, 5) of all headings, offsets and speeds, each as loud as fits best.

    They pass the middle of the sensors when most energy was heard, at speeds by which the energy
    lasts as long as it did. The power is least squares of a over r^-alpha.
    """
    middle = np.asarray(given.sensors.mean(axis=0), float)
    apart = np.linalg.norm(given.sensors - middle, axis=1)
    radius = math.sqrt(float(apart @ apart) / apart.size)
    every = max(1, given.t_s.size // _MOST)
    t_s = given.t_s[::every] - given.start_s
    value, sensor = given.value[::every], given.sensor[::every]
    when, lasts = _heard(t_s, value)
    heading = 2.0 * math.pi * np.arange(HEADINGS) / HEADINGS
    shape = np.meshgrid(heading, OFFSETS, SPEEDS, indexing="ij")
    angle, offset, speed = (part.ravel() for part in shape)
    ahead = np.column_stack([np.cos(angle), np.sin(angle)])
    v = ahead * (speed * radius / lasts)[:, None]
    aside = np.column_stack([-ahead[:, 1], ahead[:, 0]]) * (offset * radius)[:, None]
    x0 = middle + aside - when * v
    away = x0[:, None] + t_s[:, None] * v[:, None] - given.sensors[sensor]
    alpha = given.models[0].exponent
    g = np.maximum(np.linalg.norm(away, axis=-1), 0.05 * radius + 1e-9) ** -alpha
    level = np.maximum(g @ value / np.sum(g**2, axis=1), 1e-6 * float(np.abs(value).max()) + 1e-12)
    return np.column_stack([level**2, x0, v])


def searched_starts(given: RawPass, starts: Matrix, *, most: int = 8) -> Matrix:
    """Choose the `most` best places (k, 5) to set out from, of `starts` (b, 5) and of all over.

    Each is followed for a few steps only, on a part of the samples.
    """
    every = max(1, given.t_s.size // _MOST)
    part = given._replace(
        sensor=given.sensor[::every], t_s=given.t_s[::every], value=given.value[::every]
    )
    ends = fits(part, np.concatenate([starts, spread_starts(given)]), within=_LIKELY, iterations=8)
    found = possible_starts(np.array([end.theta[:5] for end in ends[:most]]).reshape(-1, 5))
    return np.concatenate([starts, found])


def possible_starts(starts: Matrix) -> Matrix:
    """Keep starts (b, 5) that are numbers of a size to go on from."""
    sound = np.isfinite(starts).all(axis=1) & (starts[:, 0] > 0.0)
    return starts[sound & (np.abs(starts[:, 1:]) < _FAR).all(axis=1)]


def flipped_starts(given: RawPass, theta: Matrix) -> Matrix:
    """Each trajectory (b, 5) moved aside, so that it passes one sensor on its other side: (b k, 5).

    One sensor hears no difference; where it is by far the loudest, the others hardly do.
    """
    v = theta[:, 3:5]
    speed = np.maximum(np.linalg.norm(v, axis=1), 1e-300)
    n = np.column_stack([-v[:, 1], v[:, 0]]) / speed[:, None]
    apart = theta[:, None, 1:3] - given.sensors  # (b, k, 2)
    aside = np.sum(apart * n[:, None], axis=-1)
    out = np.repeat(theta[:, None], len(given.sensors), axis=1)
    out[..., 1:3] -= 2.0 * aside[..., None] * n[:, None]
    return out.reshape(-1, 5)


def _heard(t_s: Vector, value: Vector) -> tuple[float, float]:
    """When most energy was heard, and for how long: mean and deviation of its times."""
    energy = np.maximum(value, 0.0) ** 2
    total = float(energy.sum())
    weight = energy / total if total > 0.0 else np.full(t_s.shape, 1.0 / t_s.size)
    when = float(weight @ t_s)
    lasts = math.sqrt(float(weight @ (t_s - when) ** 2))
    return when, max(lasts, 1e-3 * float(np.ptp(t_s)), 1e-6)
