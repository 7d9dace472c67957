"""Cheng: a straight pass between four sensors of angular rate, by the observer and by filters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from trackfield.filtering import angle_observer, angle_tracker, extended, kalman, pcrb
from trackfield.filtering.angle_readings import AngleReadings, AngleSensors, expected, of_site
from trackfield.filtering.scans import Scan
from trackfield.localization.information import fisher_information, reading_gains
from trackfield.motion import ConstantVelocity
from trackfield.network.site import Site, Target
from trackfield.sensing.angular_rate import AngularRateModel
from trackfield.types import Gaussian, Matrix, Vector

SIGMA_RAD_S = 0.01
START_ERROR_M = 0.1
OBSERVER, ALONE = "ODE observer (33)", "each scan by itself"
IEKF, TOLD, UNTOLD = "iterated EKF", "tracker, told of the motion", "tracker, told nothing"
METHODS = (OBSERVER, ALONE, IEKF, TOLD, UNTOLD)
_CORNERS = np.array([[0.5, 0.25], [-0.5, 0.25], [-0.5, -0.25], [0.5, -0.25]])
_ACCEL_DENSITY = 3e-8  # of the target's own motion, over the square of the field's size [1/s^3]
_VELOCITY_ERROR = 0.1  # of the speed, per axis, of which the start is wrong
_NEWTON = extended.Iteration(steps=8, rounds=1)
_NO_PRIOR = 3.0  # sizes of the field: what is as good as not known
_LOST = 0.1  # of the field's size: a greater error at the end counts as lost


class Passing(NamedTuple):
    """A field `size_m` long and half as wide, crossed in `duration_s`, a scan every `step_s`."""

    name: str
    size_m: float
    duration_s: float
    step_s: float


FIELD = Passing("6 x 3 m", 6.0, 5.0, 0.02)
TABLE = Passing("0.6 x 0.3 m, Example 5.1", 0.6, 5.0, 0.05)
PASSINGS = (FIELD, TABLE)


class Pass(NamedTuple):
    """Errors of all runs of a passing.

    `error_m` holds (runs, times) by method, NaN before a track is shown; `bound_m` (times,) is the
    root of the posterior Cramer-Rao bound's trace, given the start that the filters are told.
    """

    passing: Passing
    t_s: Vector
    error_m: Mapping[str, Matrix]
    bound_m: Vector

    def rmse(self, method: str) -> float:
        """RMSE at the end, lost runs too [m]."""
        return float(np.sqrt(np.nanmean(self.error_m[method][:, -1] ** 2)))

    def efficiency(self, method: str) -> float:
        """RMSE at the end over the bound."""
        return self.rmse(method) / float(self.bound_m[-1])

    def lost(self, method: str) -> float:
        """Share of runs that end far off, or without a track."""
        near = self.error_m[method][:, -1] <= _LOST * self.passing.size_m
        return float(1.0 - near.mean())

    def over_time(self, method: str) -> Vector:
        """RMSE (times,) [m], NaN while fewer than half of the runs show a track."""
        squares = self.error_m[method] ** 2
        enough = np.isfinite(squares).mean(axis=0) >= 0.5
        out = np.full(squares.shape[1], np.nan)
        out[enough] = np.sqrt(np.nanmean(squares[:, enough], axis=0))
        return out


def site_of(passing: Passing, target: Target) -> Site:
    """Lay out four sensors at the corners."""
    places = np.column_stack([passing.size_m * _CORNERS, np.full(4, np.nan)])
    models = (AngularRateModel(SIGMA_RAD_S),) * 4
    return Site(passing.name, ("a", "b", "c", "d"), places, models, target)


def passes(passing: Passing, runs: int, *, tracked: int, rng: np.random.Generator) -> Pass:
    """Draw passes, a little off the middle line, and follow them by every method.

    All are told a start that is 0.1 m off, whichever way, but for the trackers: these find their
    own, in the first `tracked` runs.
    """
    size = passing.size_m
    told = Target(motion="cv", accel_sigma_m_s2=float(np.sqrt(_ACCEL_DENSITY) * size))
    sensors = of_site(site_of(passing, told))
    motion = ConstantVelocity(_ACCEL_DENSITY * size**2)
    path = _paths(passing, runs, motion, rng)
    t_s: Vector = passing.step_s * np.arange(path.shape[1], dtype=float)
    z = expected(sensors, path) + SIGMA_RAD_S * rng.standard_normal((*path.shape[:2], 4))
    angle = rng.uniform(0.0, 2.0 * np.pi, runs)
    off = START_ERROR_M * np.column_stack([np.cos(angle), np.sin(angle)])
    speed = size / passing.duration_s
    wrong = np.concatenate([off, _VELOCITY_ERROR * speed * rng.standard_normal((runs, 2))], axis=1)
    believed = [START_ERROR_M**2 / 2.0] * 2 + [(_VELOCITY_ERROR * speed) ** 2] * 2
    start = Gaussian(path[:, 0] + wrong, np.tile(np.diag(believed), (runs, 1, 1)))
    record = angle_observer.record(t_s, z, sensors.place[:, :2])
    found = {
        OBSERVER: angle_observer.observe(record, start.mean[:, :2]).position,
        ALONE: _by_itself(start.mean, z, sensors, t_s),
        IEKF: _filtered(start, z, sensors, motion=motion, step_s=passing.step_s),
        **{
            name: np.stack([_tracked(site_of(passing, target), t_s, one) for one in z[:tracked]])
            for name, target in ((TOLD, told), (UNTOLD, Target()))
        },
    }
    error = {
        name: np.linalg.norm(places - path[: len(places), :, :2], axis=-1)
        for name, places in found.items()
    }
    bound = _bound(np.diag(believed), path, sensors, motion=motion, step_s=passing.step_s)
    return Pass(passing, t_s, error, bound)


def _paths(
    passing: Passing, runs: int, motion: ConstantVelocity, rng: np.random.Generator
) -> Matrix:
    """States (runs, times, 4) of passes along x, from end to end."""
    size, steps = passing.size_m, round(passing.duration_s / passing.step_s)
    F, root = motion.transition(passing.step_s), np.linalg.cholesky(motion.noise(passing.step_s))
    state = np.zeros((runs, 4))
    state[:, 0], state[:, 1], state[:, 2] = -0.5 * size, 0.05 * size, size / passing.duration_s
    path = [state]
    for _ in range(steps):
        path.append(path[-1] @ F.T + rng.standard_normal((runs, 4)) @ root.T)
    return np.stack(path, axis=1)


def _by_itself(start: Matrix, z: Matrix, sensors: AngleSensors, t_s: Vector) -> Matrix:
    """Solve every scan (runs, times, n) by Gauss-Newton steps from the last answer, no filter."""
    wide = np.tile((_NO_PRIOR * np.ptp(sensors.place[:, 0])) ** 2 * np.eye(4), (len(start), 1, 1))
    believed = Gaussian(start, wide)
    out: list[Matrix] = []
    for k, dt in enumerate(np.diff(t_s, prepend=t_s[0])):
        ahead = believed.mean @ ConstantVelocity(0.0).transition(float(dt)).T
        scan = AngleReadings(sensors, z[:, k])
        with np.errstate(invalid="ignore"):  # what goes astray has no covariance
            found = extended.iterate(
                Gaussian(ahead, believed.covariance), z[:, k], scan, iteration=_NEWTON
            )
        mean = found.update.posterior.mean
        sane = np.all(np.abs(mean) < 1e3, axis=-1, keepdims=True)
        believed = believed._replace(mean=np.where(sane, mean, ahead))
        out.append(believed.mean[:, :2])
    return np.stack(out, axis=1)


def _filtered(
    start: Gaussian, z: Matrix, sensors: AngleSensors, *, motion: ConstantVelocity, step_s: float
) -> Matrix:
    """Places (runs, times, 2) of the iterated EKF from a start that is told."""
    belief, out = start, list[Matrix]()
    for k in range(z.shape[1]):
        if k:
            belief = kalman.predict(belief, motion.transition(step_s), motion.noise(step_s))
        scan = AngleReadings(sensors, z[:, k])
        belief = extended.iterate(belief, z[:, k], scan).update.posterior
        out.append(belief.mean[:, :2])
    return np.stack(out, axis=1)


def _tracked(site: Site, t_s: Vector, z: Matrix) -> Matrix:
    """Places (times, 2) that the default tracker shows, NaN before it does."""
    tracker = angle_tracker.create(site)
    rows, untold = np.arange(4, dtype=np.int32), np.full(4, np.nan)
    state, out = tracker.start(), np.full((t_s.size, 2), np.nan)
    for k, time in enumerate(t_s):
        state = tracker.step(state, Scan(float(time), rows, z[k], untold))
        shown = tracker.shown(state, float(time))
        if shown is not None:
            out[k] = shown.position[:2]
    return out


def _bound(
    start: Matrix, path: Matrix, sensors: AngleSensors, *, motion: ConstantVelocity, step_s: float
) -> Vector:
    """Root of the trace of the posterior Cramer-Rao bound of places, (times,) [m]."""
    model, places = AngularRateModel(SIGMA_RAD_S), sensors.place[:, :2]
    bound, out = start, np.empty(path.shape[1])
    for k in range(path.shape[1]):
        told = fisher_information(reading_gains(model, places, path[:, k])).mean(axis=0)
        bound = pcrb.step(bound, motion, dt_s=step_s if k else 0.0, information=told)
        out[k] = np.sqrt(np.trace(bound[:2, :2]))
    return out
