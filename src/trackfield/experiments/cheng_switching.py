"""Cheng, section 4: which few sensors sense as a target moves, and what silence says."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from trackfield.filtering import angle_tracker, extended, kalman
from trackfield.filtering.angle_readings import (
    AngleReadings,
    AngleSensors,
    expected,
    of_site,
)
from trackfield.filtering.angle_settings import settings
from trackfield.filtering.scans import Scan
from trackfield.motion import ConstantVelocity
from trackfield.network.site import Site, Target
from trackfield.scheduling import sensor_switching
from trackfield.sensing.angular_rate import AngularRateModel
from trackfield.types import Gaussian, Indices, Matrix, Vector

Rule = Literal["the first four", "rule of the paper", "nearest", "information", "all twelve"]
RULES: tuple[Rule, ...] = (
    "the first four",
    "rule of the paper",
    "nearest",
    "information",
    "all twelve",
)
ACTIVE = 4
_STEP_S, _STEPS, _EVERY = 0.05, 100, 5
_SIGMA_RAD_S = 0.01
THRESHOLD_RAD_S = 0.4
"""Below it the sensors of `silent` say nothing."""
_FIELD_M = (6.0, 4.0)
_MOTION = ConstantVelocity(2e-4)
_START = np.array([0.1, 0.1, 0.1, 0.1])  # sigma of what is told at the start


class Switched(NamedTuple):
    """Errors (rules, runs, times) [m] of an iterated EKF whose four sensors each rule chooses."""

    t_s: Vector
    error_m: Matrix

    def rmse(self, rule: Rule) -> float:
        """RMSE over all runs and the second half of the time [m]."""
        errors: Matrix = self.error_m[RULES.index(rule)]
        return float(np.sqrt(np.mean(errors[:, _STEPS // 2 :] ** 2)))


class Silent(NamedTuple):
    """Errors (2, runs, times) [m] of the tracker: silence ignored, and believed; NaN without track.

    `spoken` is the share of readings above the threshold; `inside` (2,) how often the truth is in
    the 95 % ellipse.
    """

    t_s: Vector
    error_m: Matrix
    inside: Vector
    spoken: float

    def rmse(self, believed: int) -> float:
        """RMSE over all runs and the second half of the time [m]."""
        errors: Matrix = self.error_m[believed]
        return float(np.sqrt(np.nanmean(errors[:, _STEPS // 2 :] ** 2)))

    def median(self, believed: int) -> float:
        """Median error, likewise [m]."""
        errors: Matrix = self.error_m[believed]
        return float(np.nanmedian(errors[:, _STEPS // 2 :]))


def places() -> Matrix:
    """Places (12, 2) of the sensors: all round the field, in order."""
    x, y = (0.5 * side * np.array([-1.0, -1.0 / 3.0, 1.0 / 3.0, 1.0]) for side in _FIELD_M)
    top, bottom = (np.column_stack([x, np.full(4, side)]) for side in (y[0], y[-1]))
    sides = [[(side, y[1]), (side, y[2])] for side in (x[0], x[-1])]
    return np.vstack([top, np.array(sides[1]), bottom[::-1], np.array(sides[0])[::-1]])


def switched(runs: int, rng: np.random.Generator) -> Switched:
    """Follow passes through the field, with the same noise for every rule."""
    sensors = of_site(_site(0.0))
    path = _paths(runs, rng)
    z = expected(sensors, path) + _SIGMA_RAD_S * rng.standard_normal((*path.shape[:2], 12))
    start = Gaussian(
        path[:, 0] + _START * rng.standard_normal((runs, 4)),
        np.tile(np.diag(_START**2), (runs, 1, 1)),
    )
    errors = [_followed(rule, start, z, sensors) - path[:, :, :2] for rule in RULES]
    return Switched(_times(), np.linalg.norm(errors, axis=-1))


def silent(runs: int, rng: np.random.Generator) -> Silent:
    """Track passes by sensors that speak only of rates above a threshold."""
    site = _site(THRESHOLD_RAD_S)
    sensors = of_site(site)
    path = _paths(runs, rng)
    z = expected(sensors, path) + _SIGMA_RAD_S * rng.standard_normal((*path.shape[:2], 12))
    believed = settings(site, sensors)
    filters = [
        angle_tracker.AngleFilter(sensors, believed._replace(silence=silence))
        for silence in (False, True)
    ]
    found = [
        [_tracked(tracker, one, truth) for one, truth in zip(z, path, strict=True)]
        for tracker in filters
    ]
    tables = np.array(found)  # (2, runs, times, 2): error, whether inside
    inside = np.nanmean(tables[..., 1], axis=(1, 2))
    spoken = float(np.mean(np.abs(z) >= THRESHOLD_RAD_S))
    return Silent(_times(), tables[..., 0], inside, spoken)


def _times() -> Vector:
    return _STEP_S * np.arange(_STEPS, dtype=np.float64)


def _site(threshold: float) -> Site:
    at = np.column_stack([places(), np.full(12, np.nan)])
    model = AngularRateModel(_SIGMA_RAD_S, threshold_rad_s=threshold)
    names = tuple(f"s{i}" for i in range(12))
    return Site("ring of twelve", names, at, (model,) * 12, Target())


def _paths(runs: int, rng: np.random.Generator) -> Matrix:
    """States (runs, times, 4) of passes from the left to the right, at any slant."""
    state = np.column_stack(
        [
            np.full(runs, -0.4 * _FIELD_M[0]),
            rng.uniform(-0.35, 0.35, runs) * _FIELD_M[1],
            np.full(runs, 0.8 * _FIELD_M[0] / (_STEP_S * _STEPS)),
            rng.uniform(-0.05, 0.05, runs) * _FIELD_M[1],
        ]
    )
    F, root = _MOTION.transition(_STEP_S), np.linalg.cholesky(_MOTION.noise(_STEP_S))
    path = [state]
    for _ in range(_STEPS - 1):
        path.append(path[-1] @ F.T + rng.standard_normal((runs, 4)) @ root.T)
    return np.stack(path, axis=1)


def _followed(rule: Rule, start: Gaussian, z: Matrix, sensors: AngleSensors) -> Matrix:
    """Places (runs, times, 2) of the iterated EKF; every quarter of a second the rule chooses."""
    runs = len(z)
    active = np.tile(np.arange(ACTIVE, dtype=np.int32), (runs, 1))
    belief, out = start, np.empty((*z.shape[:2], 2))
    for k in range(z.shape[1]):
        if k:
            belief = kalman.predict(belief, _MOTION.transition(_STEP_S), _MOTION.noise(_STEP_S))
        if k % _EVERY == 0:
            active = np.array(
                [
                    _choice(
                        rule, Gaussian(belief.mean[i], belief.covariance[i]), active[i], sensors
                    )
                    for i in range(runs)
                ]
            )
        heard = np.full(z[:, k].shape, np.nan)
        np.put_along_axis(heard, active, np.take_along_axis(z[:, k], active, axis=1), axis=1)
        scan = AngleReadings(sensors, heard)
        belief = extended.iterate(belief, heard, scan).update.posterior
        out[:, k] = belief.mean[:, :2]
    return out


def _choice(rule: Rule, belief: Gaussian, active: Indices, sensors: AngleSensors) -> Indices:
    """Choose the sensors that sense next."""
    at, everyone = sensors.place[:, :2], np.arange(12, dtype=np.int32)
    match rule:
        case "rule of the paper":
            now = belief.mean[:2]
            return sensor_switching.switch(
                now, at, active=active, usable=_seeing(at, now), k=ACTIVE
            ).sensors
        case "nearest":
            order = np.argsort(np.linalg.norm(at - belief.mean[:2], axis=1), kind="stable")
            return order[:ACTIVE].astype(np.int32)
        case "information":
            return sensor_switching.informative(
                AngularRateModel(_SIGMA_RAD_S),
                at,
                belief.mean,
                prior=np.asarray(np.linalg.inv(belief.covariance), float),
                usable=everyone,
                k=ACTIVE,
            ).sensors
        case "all twelve":
            return everyone
        case _:
            return active


def _seeing(at: Matrix, now: Vector) -> Indices:
    """Return the six nearest: the range constraint that the paper asks for besides its rule."""
    order = np.argsort(np.linalg.norm(at - now, axis=1), kind="stable")
    return np.sort(order[:6]).astype(np.int32)


def _tracked(tracker: angle_tracker.AngleFilter, z: Matrix, path: Matrix) -> Matrix:
    """Errors, and whether the truth is in the 95 % ellipse, (times, 2), NaN before a track."""
    state, out = tracker.start(), np.full((len(z), 2), np.nan)
    for k, row in enumerate(z):
        rows = np.flatnonzero(np.abs(row) >= THRESHOLD_RAD_S).astype(np.int32)
        scan = Scan(_STEP_S * k, rows, row[rows], np.full(rows.size, np.nan))
        state = tracker.step(state, scan)
        shown = tracker.shown(state, scan.t_s)
        if shown is not None:
            e = shown.position[:2] - path[k, :2]
            xx, xy, yy = shown.covariance
            distance2 = e @ np.linalg.solve(np.array([[xx, xy], [xy, yy]]), e)
            out[k] = np.hypot(*e), distance2 <= 5.99
    return out
