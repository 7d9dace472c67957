"""Trajectory of a pass from all raw amplitudes: maximum likelihood, Berger (3), (39).

What reduced data are measured against: a sensor sends every sample. Also the last word where all
samples are at one place anyway.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield._core import _trajectory
from trackfield.errors import InputError
from trackfield.linalg import covariance_of
from trackfield.sensing.amplitude import AmplitudeModel
from trackfield.types import Indices, Matrix, Vector

ITERATIONS = 200
DONE = 1e-12  # promised gain of log-likelihood at which a search ends: 1e-6 standard deviations
_FAR = 1e9  # places, times and speeds beyond it are no use [m], [s], [m/s]


class RawPass(NamedTuple):
    """Samples of one pass: `sensor` (n,) says whose of `sensors` (k, 2) [m] each is.

    `t_s` and `value` (n,) are the sensor's own time and the amplitude it read, in any order;
    `models` are the k sensors' own. `start_s` is the time at which the trajectory's position is
    told; near the samples, so that large times cost no digits.
    """

    sensors: Matrix
    models: tuple[AmplitudeModel, ...]
    sensor: Indices
    t_s: Vector
    value: Vector
    start_s: float = 0.0


class RawFit(NamedTuple):
    """Straight trajectory x(t) = x0 + (t - start_s) v of a source of power P, and how well it fits.

    `theta` (5,) holds P (at 1 m), x0 (2,) [m], v (2,) [m/s], `covariance` (5, 5) is the inverse of
    the Fisher matrix there; with an estimated exponent both have a sixth entry. `clock_s` (k,) is
    how far each sensor's clock is ahead, 0 where clocks agree. `cost` is the negative
    log-likelihood (without what does not depend on theta) with the clocks' prior, `costs` (k,) its
    shares by sensor. `misfit` compares the squared misfit (or deviance, with fading) with what it
    is on average, in its own standard deviations: beyond 4 a straight pass of one source is
    doubtful. `converged`: the search ended at a minimum; `determined` is false where samples leave
    a direction free; its variance is then huge, not infinite.
    """

    theta: Vector
    covariance: Matrix
    clock_s: Vector
    cost: float
    costs: Vector
    misfit: float
    iterations: int
    converged: bool
    determined: bool


def fit(given: RawPass, start: Vector, *, free_exponent: bool = False) -> RawFit:
    """Find the maximum of the likelihood of all samples, Berger (3) or (39), from `start` (5,).

    Levenberg-Marquardt with the Fisher matrix (5), (40). Samples at a sensor's saturation count as
    "at least that much"; a clock with `clock_sigma_s` > 0 is estimated along, under its prior. With
    `free_exponent` the exponent is too: what all sensors' own are off by, alike.
    """
    return fits(given, start, free_exponent=free_exponent)[0]


def fits(
    given: RawPass,
    starts: Matrix,
    *,
    free_exponent: bool = False,
    within: float = math.inf,
    iterations: int = ITERATIONS,
) -> tuple[RawFit, ...]:
    """Run `fit` from `starts` (b, 5), best first; a mirror image may fit as well as the truth.

    Only ends whose cost is at most `within` above the best are told; each one once. A search ends
    after `iterations`, converged or not.
    """
    _check(given)
    samples = _sorted(given)
    unknowns, clock_s, costs, information, steps, converged = _trajectory.fit(
        _unknowns(starts), samples.table, samples.bounds, samples.t_s, samples.value,
        free_exponent, iterations, DONE,
    )  # fmt: skip
    out: list[RawFit] = []
    total = costs.sum(axis=1)
    known: set[tuple[float, ...]] = set()
    for i in np.argsort(total, kind="stable"):
        place = tuple(float(f"{number:.5g}") for number in unknowns[i])
        if total[i] > total.min() + within or (place in known and math.isfinite(within)):
            continue
        known.add(place)
        theta, covariance, determined = _told(unknowns[i], information[i], given)
        out.append(
            RawFit(
                theta,
                covariance,
                clock_s[i],
                float(costs[i].sum()),
                costs[i],
                _misfit(samples, unknowns[i], clock_s[i]),
                int(steps[i]),
                bool(converged[i]),
                determined and bool(np.isfinite(theta).all()),
            )
        )
    return tuple(out)


class _Samples(NamedTuple):
    """What the kernel takes: sensors as a table (k, 7), samples sensor after sensor."""

    table: Matrix
    bounds: NDArray[np.int64]
    sensor: NDArray[np.int64]
    t_s: Vector
    value: Vector


def _sorted(given: RawPass) -> _Samples:
    order = np.argsort(given.sensor, kind="stable")
    sensor = np.asarray(given.sensor, np.int64)[order]
    bounds = np.searchsorted(sensor, np.arange(len(given.models) + 1)).astype(np.int64)
    traits = [
        (m.exponent, m.sigma, m.saturation, m.clock_sigma_s, float(m.fading == "rayleigh"))
        for m in given.models
    ]
    table = np.column_stack([given.sensors, np.array(traits, float).reshape(-1, 5)])
    t_s = np.ascontiguousarray(given.t_s[order] - given.start_s)
    return _Samples(table, bounds, sensor, t_s, np.ascontiguousarray(given.value[order], float))


def _unknowns(starts: Matrix) -> Matrix:
    """Unknowns of the kernel (b, 6): log sqrt(P), x0, v, and by how much the exponent is off."""
    given = np.atleast_2d(np.asarray(starts, float))
    if given.ndim != 2 or given.shape[1] not in (5, 6) or not len(given):
        raise InputError(f"starts of shape {given.shape}: expected (b, 5): P, x0 (2), v (2)")
    if not (np.abs(given[:, 1:]) < _FAR).all() or not (given[:, 0] > 0.0).all():
        raise InputError("starts: expected a power above 0, and finite places and velocities")
    if not np.isfinite(given[:, 0]).all():
        raise InputError("starts: found an infinite power")
    log_amplitude = 0.5 * np.log(given[:, 0])
    return np.column_stack([log_amplitude, given[:, 1:5], np.zeros(len(given))])


def _told(unknowns: Vector, information: Matrix, given: RawPass) -> tuple[Vector, Matrix, bool]:
    """Return theta with its covariance, and whether samples fix all of it."""
    size = len(information)
    scale = np.sqrt(np.maximum(np.diag(information), 1e-40))  # so that units are alike
    scaled, determined = covariance_of(information / np.outer(scale, scale))
    power = math.exp(min(max(2.0 * unknowns[0], -230.0), 230.0))  # 1e-100 to 1e100
    slope = np.ones(size)
    slope[0] = 2.0 * power
    theta = np.array([power, *unknowns[1:size]])
    if size > 5:
        theta[5] += given.models[0].exponent
    return theta, scaled * np.outer(slope / scale, slope / scale), bool(determined)


def _misfit(samples: _Samples, unknowns: Vector, clock_s: Vector) -> float:
    """How much worse than on average the fit is, in standard deviations of that."""
    own = samples.table[samples.sensor]
    t = samples.t_s - clock_s[samples.sensor]
    offset = unknowns[1:3] + t[:, None] * unknowns[3:5] - own[:, :2]
    r = np.maximum(np.hypot(offset[:, 0], offset[:, 1]), 1e-9)
    a = np.exp(np.minimum(unknowns[0] - (own[:, 2] + unknowns[5]) * np.log(r), 300.0))
    sigma, saturation, fades = own[:, 3], own[:, 4], own[:, 6] > 0.0
    v = sigma**2 + a**2
    ratio = np.maximum(samples.value**2 / v, 1e-12)
    squared = (((samples.value - a) / sigma) ** 2 - 1.0) / math.sqrt(2.0)
    faded = (ratio - 1.0 - np.log(ratio) - np.euler_gamma) / math.sqrt(math.pi**2 / 6.0 - 1.0)
    # Chosen by what is expected, not by what was read: samples that are hardly ever cut.
    rare = np.asarray(np.where(fades, np.sqrt(6.0 * v), a + 3.0 * sigma), float)
    whole = np.asarray(saturation > rare, bool)
    excess = np.asarray(np.where(fades, faded, squared), float) * whole
    return float(np.sum(excess)) / math.sqrt(max(np.count_nonzero(whole), 1))


def _check(given: RawPass) -> None:
    """Raise `InputError` for shapes that do not match, and for what is not finite."""
    n = given.t_s.size
    if given.sensors.ndim != 2 or given.sensors.shape != (len(given.models), 2):
        raise InputError(f"sensors of shape {given.sensors.shape}, {len(given.models)} models")
    if given.sensor.shape != (n,) or given.value.shape != (n,) or given.t_s.shape != (n,):
        raise InputError("sensor, t_s and value: expected the same shape (n,)")
    if n == 0:
        raise InputError("found no samples, expected some of three sensors")
    if given.sensor.min() < 0 or given.sensor.max() >= len(given.models):
        raise InputError(
            f"sensor: found {given.sensor.max()}, expected 0 to {len(given.models) - 1}"
        )
    for name, column in (("t_s", given.t_s - given.start_s), ("value", given.value)):
        if not np.isfinite(column).all() or np.abs(column).max() > _FAR:
            raise InputError(f"{name}: expected finite numbers within 1e9")
    if not np.isfinite(given.sensors).all():
        raise InputError("sensors: expected finite places")
