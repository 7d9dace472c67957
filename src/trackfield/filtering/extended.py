"""Extended Kalman filters: readings that are curved functions of the state, linearized.

`update` linearizes once, at the prediction. `iterate` linearizes where the readings themselves put
the target, by Gauss-Newton steps that are shortened until they descend; it survives bad starts.
All take leading axes, like `filtering.kalman`; a reading that is NaN was not made.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from trackfield.filtering import kalman
from trackfield.filtering.matrices import apply, transposed
from trackfield.motion import CurvedMotion, Motion
from trackfield.sensing import range as ranging
from trackfield.sensing.range import RangeModels
from trackfield.types import Gaussian, Matrix, Vector


class Sensor(Protocol):
    """z = h(x) + v with independent noise; states (..., n), readings (..., m)."""

    def predict(self, state: Vector) -> Vector:
        """h: expected readings (..., m)."""
        ...

    def jacobian(self, state: Vector) -> Matrix:
        """dh/dx (..., m, n)."""
        ...

    def variance(self, reading: Vector) -> Vector:
        """Noise variances (..., m) where readings of this size are expected or were made."""
        ...


class Weigh(Protocol):
    """A robust rule (`filtering.robust`): how far to believe readings that do not fit."""

    def __call__(self, residual: Vector, spread: Vector, variance: Vector) -> Noise:
        """Noise to assume instead of N(0, variance), where `residual` has variance `spread`."""
        ...


class Noise(NamedTuple):
    """v ~ N(bias, variance) for each reading, (..., m) each; `trust` in [0, 1] is for diagnosis."""

    bias: Vector
    variance: Vector
    trust: Vector


@dataclass(frozen=True, slots=True, eq=False)
class Ranges:
    """Distances to `sensors` (m, d) under `models`, of states that begin with the position."""

    sensors: Matrix
    models: RangeModels

    def predict(self, state: Vector) -> Vector:
        """Return expected ranges (..., m) [m], Wang (2)."""
        return ranging.expected(self.models, ranging.distance(self.sensors, self._position(state)))

    def jacobian(self, state: Vector) -> Matrix:
        """Return slopes (..., m, n); zero for a sensor at the target, where none exists."""
        H = np.zeros((*state.shape[:-1], len(self.sensors), state.shape[-1]))
        d = self.sensors.shape[1]
        H[..., :d] = ranging.jacobian(self.models, self.sensors, positions=self._position(state))
        return H

    def variance(self, reading: Vector) -> Vector:
        """Return sigma_n^2 + sigma_gamma^2 r^2 (..., m) [m^2] of the distance r it stands for."""
        return ranging.variance(self.models, ranging.corrected(self.models, reading))

    def _position(self, state: Vector) -> Vector:
        return state[..., : self.sensors.shape[1]]


class Iteration(NamedTuple):
    """How long `iterate` tries: steps in each round, rounds of new noise, what counts as done."""

    steps: int = 20
    rounds: int = 2
    halvings: int = 8
    tolerance: float = 1e-4  # largest move, in standard deviations of the result


class Iterated(NamedTuple):
    """What `iterate` found; `converged` (...), `noise` as assumed in the end."""

    update: kalman.Update
    converged: NDArray[np.bool_]
    noise: Noise


def predict(belief: Gaussian, motion: CurvedMotion, *, dt_s: float) -> Gaussian:
    """Carry a belief through a curved motion, linearized at the mean."""
    F = motion.jacobian(belief.mean, dt_s)
    covariance = F @ belief.covariance @ transposed(F) + motion.noise(dt_s)
    return Gaussian(motion.move(belief.mean, dt_s), covariance)


def update(
    prior: Gaussian, z: Vector, sensor: Sensor, *, variance: Vector | None = None
) -> kalman.Update:
    """Condition on z = h(x) + v, linearized at the prior mean; noise of the readings' size.

    This equals a Kalman update with ONE Gauss-Newton step of prelocalization taken from the
    prediction; see `filtering.converted`. `variance` (..., m) replaces the sensor's own: Wang 4.2
    takes sigma_n^2 + sigma_gamma^2 z^2, bias and scale left in z.
    """
    v = sensor.variance(z) if variance is None else variance
    innovation = z - sensor.predict(prior.mean)
    return kalman.assimilate(prior, innovation, sensor.jacobian(prior.mean), variance=v)


def iterate(
    prior: Gaussian,
    z: Vector,
    sensor: Sensor,
    *,
    weigh: Weigh | None = None,
    iteration: Iteration = Iteration(),  # noqa: B008 (immutable)
) -> Iterated:
    """Condition on z = h(x) + v, linearized at the most likely state: iterated, information form.

    First the noise has the size that the readings suggest; once converged, that which the fitted
    state suggests, reweighed by `weigh`, again `rounds` - 1 times. Each Gauss-Newton step is halved
    until |x - mean|^2_{P^-1} + sum (z - h(x))^2/v descends.
    """
    noise = Noise(np.zeros_like(z), sensor.variance(z), np.ones_like(z))
    point = _Point(prior.mean, np.zeros_like(prior.mean))
    moved = np.full(z.shape[:-1], np.inf)
    for turn in range(iteration.rounds):
        if turn > 0:
            noise = _noise_at(prior, point.x, z, sensor=sensor, noise=noise, weigh=weigh)
        # The noise will change again: only the last round must be exact.
        last = turn == iteration.rounds - 1
        enough = iteration.tolerance if last else math.sqrt(iteration.tolerance)
        moved = np.full(z.shape[:-1], np.inf)
        for _ in range(iteration.steps):
            going = moved > enough  # what has arrived stays: its neighbours must not change it
            if not going.any():
                break
            then, stride = _descend(prior, point, z - noise.bias, sensor, noise.variance, iteration)
            point = _Point(
                *(np.where(going[..., None], b, a) for a, b in zip(point, then, strict=True))
            )
            moved = np.where(going, stride, moved)
    final = _linearized(prior, point.x, z - noise.bias, sensor=sensor, variance=noise.variance)
    return Iterated(final, moved <= iteration.tolerance, noise)


def step(
    belief: Gaussian, z: Vector, *, sensor: Sensor, motion: Motion, dt_s: float
) -> tuple[Gaussian, kalman.Info]:
    """Predict by `dt_s`, then `update`."""
    prior = kalman.predict(belief, motion.transition(dt_s), motion.noise(dt_s))
    updated = update(prior, z, sensor)
    return updated.posterior, kalman.Info(prior, updated)


def step_iterated(
    belief: Gaussian,
    z: Vector,
    *,
    sensor: Sensor,
    motion: Motion,
    dt_s: float,
    weigh: Weigh | None = None,
) -> tuple[Gaussian, kalman.Info]:
    """Predict by `dt_s`, then `iterate`."""
    prior = kalman.predict(belief, motion.transition(dt_s), motion.noise(dt_s))
    updated = iterate(prior, z, sensor, weigh=weigh).update
    return updated.posterior, kalman.Info(prior, updated)


class _Point(NamedTuple):
    """A state x and y = P^-1 (x - mean), which steps yield without inverting P."""

    x: Vector
    y: Vector


def _linearized(
    prior: Gaussian, x: Vector, z: Vector, *, sensor: Sensor, variance: Vector
) -> kalman.Update:
    """Condition on the readings linearized at x: one undamped Gauss-Newton step from x."""
    H = sensor.jacobian(x)
    innovation = z - sensor.predict(x) - apply(H, prior.mean - x)
    return kalman.assimilate(prior, innovation, H, variance=variance)


def _descend(
    prior: Gaussian,
    point: _Point,
    z: Vector,
    sensor: Sensor,
    variance: Vector,
    iteration: Iteration,
) -> tuple[_Point, Vector]:
    """Take one Gauss-Newton step, halved where it would not descend; also its greatest move."""
    made = ~np.isnan(z)
    weight = np.where(made, 1.0 / np.where(made, variance, 1.0), 0.0)
    H = sensor.jacobian(point.x)
    misfit = z - sensor.predict(point.x)
    e = np.where(made, misfit + apply(H, point.x - prior.mean), 0.0)
    shift, covariance, _ = kalman.shifted(prior.covariance, e, H, weight=weight)
    whole = _Point(prior.mean + shift, apply(transposed(H), weight * (e - apply(H, shift))))
    to_x, to_y = whole.x - point.x, whole.y - point.y

    def cost(at: _Point, misfit: Vector) -> Vector:
        of_readings = (weight * np.where(made, misfit, 0.0) ** 2).sum(-1)
        return ((at.x - prior.mean) * at.y).sum(-1) + of_readings

    before = cost(point, misfit)
    length = np.ones(before.shape)
    after = whole
    for _ in range(iteration.halvings):
        worse = cost(after, z - sensor.predict(after.x)) > before + 1e-9 * (1.0 + before)
        if not worse.any():
            break
        length = np.where(worse, 0.5 * length, length)
        after = _Point(point.x + length[..., None] * to_x, point.y + length[..., None] * to_y)
    sigma = np.sqrt(np.einsum("...ii->...i", covariance))
    moved = (np.abs(to_x) / np.maximum(sigma, 1e-300)).max(-1) * length
    return after, moved


def _noise_at(
    prior: Gaussian,
    x: Vector,
    z: Vector,
    *,
    sensor: Sensor,
    noise: Noise,
    weigh: Weigh | None,
) -> Noise:
    """Return the noise that the state x suggests, each reading judged by all others and the prior.

    A reading's own pull on the fit is taken out by its leverage l: residual e/(1 - l) with variance
    v/(1 - l).
    """
    variance = sensor.variance(sensor.predict(x))
    if weigh is None:
        return Noise(np.zeros_like(z), variance, np.ones_like(z))
    fitted = _linearized(prior, x, z - noise.bias, sensor=sensor, variance=noise.variance)
    H = sensor.jacobian(x)
    shadow = np.einsum("...mi,...ij,...mj->...m", H, fitted.posterior.covariance, H)
    free = np.maximum(1.0 - shadow / noise.variance, 1e-6)
    others = shadow / free  # variance of h(x) from all other readings and the prior
    residual = z - sensor.predict(x)
    pull = (shadow / noise.variance) / free * (residual - noise.bias)
    return weigh(residual + pull, others + variance, variance)
