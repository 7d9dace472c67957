"""Where a target is that only angles tell of: constant velocity fitted to a window of readings.

One scan of rates or scalar motion seldom fixes the state, and often has several exact answers; a
window of scans does better. The search looks at places on a grid and headings all round, with the
speed in closed form, refines the best by damped Gauss-Newton steps, and returns every answer that
the readings allow.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from trackfield.filtering.angle_readings import (
    AngleReadings,
    AngleSensors,
    Says,
    chosen,
    expected,
    slopes,
)
from trackfield.filtering.matrices import form, solve, symmetric, transposed
from trackfield.types import Gaussian, Matrix, Vector

_SCALE = 3.0  # residuals beyond so many sigmas count less and less, Cauchy
_REFINED = 64  # places and headings that get a few steps
_FINALISTS = 12  # that are refined to the end
_STEPS = 30
_SETTLED, _STUCK = 1e-4, 1e3  # gain of a step, or damping, at which an answer is as good as found
_APART2 = 9.0  # squared standard deviations from which on two answers are two
_CREDIBLE = 12.0  # an answer may be so much less likely than the best, in log likelihood
_MOST = 4  # answers that are returned
_PLACES = {2: 21, 3: 9}  # of the grid, an axis
_READINGS = 24  # that the grid is judged by, from the middle of the window
_FASTEST = 3.0  # usual speeds that a candidate may have
_NEAR = 0.05  # of the box: how far apart places along a valley are taken up,
_ALLOWED = 12.0  # how much more than the best they may cost,
_VALLEY = 12  # and how many, with the answers
_DETERMINED = 0.2  # of the box: the sigma of a place that counts as fixed
_MOVES = 25.0  # cost that a motion must spare: of a target at rest rates tell no place


class Search(NamedTuple):
    """Where to look: the box from `lower` to `upper` (d,) [m], and the usual speed [m/s].

    Both are weak priors too: one sigma of the place about the middle of the box is its largest
    side, one sigma of the velocity about 0 is `speed_m_s`.
    """

    lower: Vector
    upper: Vector
    speed_m_s: float

    @property
    def size_m(self) -> float:
        """Largest side of the box."""
        return float((self.upper - self.lower).max())


class AngleStart(NamedTuple):
    """Answers of a window: states (k, n) and covariances, the likeliest first.

    Where the likely places make a valley, more along it follow. `determined`: the readings alone
    fix the state of the first, which rates of a target at rest never do; `fits`: they agree with
    it. Where one of them is missing nothing should be started.
    """

    beliefs: Gaussian
    determined: bool
    fits: bool


def fit(window: AngleReadings, search: Search) -> AngleStart:
    """Fit p + after_s v to all readings of a window: answers (p, v) at the time of after_s = 0.

    Minimises sum c^2 log(1 + e^2/c^2) of the residuals e in sigmas (c = 3) plus the weak priors.
    They are ranked by likelihood times the square root of the covariance's determinant, Laplace.
    """
    problem = _Problem(window, *_prior(search))
    tried = _candidates(window, search)
    states, cost = _refined(problem, tried, steps=4)
    best = np.argsort(cost, kind="stable")[:_FINALISTS]
    states, cost = _refined(problem, states[best], steps=_STEPS)
    told, _ = _normal(problem, states)
    covariance = symmetric(np.linalg.inv(told + np.diag(problem.weight)))
    log_weight = -0.5 * cost + 0.5 * np.linalg.slogdet(covariance)[1]
    keep = _distinct(states, covariance, log_weight)
    first = keep[0]
    beliefs = _with_valley(
        problem, tried, answers=Gaussian(states[keep], covariance[keep]), search=search
    )
    spare = max(window.value.size - states.shape[-1], 1)
    return AngleStart(
        beliefs,
        determined=_determined(told[first], search) and _moves(problem, states[first], search),
        fits=bool(cost[first] < 2.0 * spare + 6.0 * math.sqrt(2.0 * spare)),
    )


def misfit(window: AngleReadings, state: Vector) -> float:
    """Cost of a window as `fit` counts it, without priors, for a target in `state` (n,)."""
    nothing = np.zeros(state.size)
    return float(_cost(_Problem(window, nothing, nothing), state[None])[0])


class _Problem(NamedTuple):
    window: AngleReadings
    mean: Vector  # of the prior, (n,)
    weight: Vector


def _prior(search: Search) -> tuple[Vector, Vector]:
    d = search.lower.size
    mean = np.concatenate([0.5 * (search.lower + search.upper), np.zeros(d)])
    sigma = np.repeat([search.size_m, search.speed_m_s], d)
    return mean, sigma**-2.0


def _candidates(window: AngleReadings, search: Search) -> Matrix:
    """States (k, n) from the grid: the best by the readings in the middle, speeds in closed form.

    Rates and motion are proportional to the speed: its least squares fit costs one division. The
    target is taken to stand still in between, which the steps that follow put right; sensors too.
    """
    after = np.zeros(window.value.size) if window.after_s is None else window.after_s
    middle = np.argsort(np.abs(after - np.median(after)), kind="stable")[:_READINGS]
    sensors = chosen(window.sensors, middle)
    sensors = sensors._replace(velocity=np.zeros_like(sensors.velocity))
    places, headings = _grid(search), _headings(search.lower.size)
    aside, per_speed = _parts(sensors, window.value[middle], places, headings)
    power = (per_speed**2).sum(axis=1) + search.speed_m_s**-2.0
    speed = (per_speed * aside[..., None]).sum(axis=1) / power
    speed = np.clip(speed, 0.0, _FASTEST * search.speed_m_s)
    left = aside[..., None] - speed[:, None, :] * per_speed
    cost = np.log1p((left / _SCALE) ** 2).sum(axis=1)
    # Two headings of each place, or one place would take all the room.
    two = np.argsort(cost, axis=1, kind="stable")[:, :2]
    best = np.argsort(np.take_along_axis(cost, two, axis=1).ravel(), kind="stable")[:_REFINED]
    place, heading = best // 2, two.ravel()[best]
    velocity = speed[place, heading, None] * headings[heading]
    return np.concatenate([places[place] - np.median(after) * velocity, velocity], axis=1)


def _parts(
    sensors: AngleSensors, value: Vector, places: Matrix, headings: Matrix
) -> tuple[Matrix, Matrix]:
    """Residuals (places, m) of targets at rest, and what speed adds (places, m, headings). [sigma].

    In the plane a reading is linear in the velocity, but for the sign of motion.
    """
    k, d = places.shape
    moves = sensors.says == Says.MOTION
    rest = np.concatenate([places, np.zeros((k, d))], axis=1)
    aside = (value - AngleReadings(sensors, value).predict(rest)) / sensors.sigma
    if d == 3 or np.any(sensors.place[moves, 2]):
        each = np.broadcast_to(headings, (k, *headings.shape))
        states = np.concatenate([np.broadcast_to(places[:, None, :], each.shape), each], axis=-1)
        h = np.where(sensors.says == Says.BEARING, 0.0, expected(sensors, states))
        return aside, np.swapaxes(h / sensors.sigma, 1, 2)
    any_velocity = np.concatenate([places, np.ones((k, d))], axis=1)
    h = slopes(sensors, any_velocity)[..., d:] @ headings.T
    h[:, moves] = np.abs(h[:, moves])
    return aside, h / sensors.sigma[:, None]


def _grid(search: Search) -> Matrix:
    """Give places (k, d) all over the box."""
    d = search.lower.size
    part = np.indices([_PLACES[d]] * d).reshape(d, -1).T / (_PLACES[d] - 1.0)
    return search.lower + part * (search.upper - search.lower)


def _headings(d: int) -> Matrix:
    """Give unit vectors (k, d) all round: 16 in the plane, 26 in space."""
    if d == 2:
        angle = np.arange(16) * (2.0 * np.pi / 16)
        return np.column_stack([np.cos(angle), np.sin(angle)])
    steps = np.indices((3, 3, 3)).reshape(3, -1).T - 1.0
    steps = steps[np.any(steps != 0.0, axis=1)]
    return steps / np.linalg.norm(steps, axis=1, keepdims=True)


def _refined(problem: _Problem, states: Matrix, *, steps: int) -> tuple[Matrix, Vector]:
    """Levenberg-Marquardt from many states (k, n) at once; states and their costs."""
    cost = _cost(problem, states)
    damping = np.full(len(states), 1e-2)
    for _ in range(steps):
        told, slope = _normal(problem, states)
        H = told + np.diag(problem.weight)
        slope = slope - problem.weight * (states - problem.mean)
        diagonal = np.einsum("kii->ki", H)
        damped = H + (damping[:, None] * diagonal)[:, :, None] * np.eye(states.shape[1])
        step = solve(damped, slope)
        tried = states + step
        new = _cost(problem, tried)
        better = new < cost
        states = np.where(better[:, None], tried, states)
        gained = cost - np.where(better, new, cost)
        cost = np.where(better, new, cost)
        damping = np.clip(np.where(better, damping * 0.2, damping * 6.0), 1e-9, 1e6)
        if ((better & (gained < _SETTLED)) | (damping > _STUCK)).all():
            break
    return states, cost


def _normal(problem: _Problem, states: Matrix) -> tuple[Matrix, Vector]:
    """Information (k, n, n) of the readings and the downhill slope (k, n) of their cost."""
    window = problem.window
    H = window.jacobian(states) / window.sensors.sigma[:, None]
    e = _residual(window, states)
    weight = 1.0 / (1.0 + (e / _SCALE) ** 2)
    weighted = transposed(H) * weight[:, None, :]
    return weighted @ H, (weighted @ e[..., None])[..., 0]


def _cost(problem: _Problem, states: Matrix) -> Vector:
    e = _residual(problem.window, states)
    prior = (problem.weight * (states - problem.mean) ** 2).sum(-1)
    return _SCALE**2 * np.log1p((e / _SCALE) ** 2).sum(-1) + prior


def _residual(window: AngleReadings, states: Matrix) -> Vector:
    """Residuals (k, m) in sigmas."""
    return (window.value - window.predict(states)) / window.sensors.sigma


def _distinct(states: Matrix, covariance: Matrix, log_weight: Vector) -> list[int]:
    """Credible answers that are not the same, best first."""
    order = np.argsort(-log_weight, kind="stable")
    keep: list[int] = []
    for i in order.tolist():
        if log_weight[i] < log_weight[order[0]] - _CREDIBLE or len(keep) == _MOST:
            break
        apart = states[keep] - states[i]
        if (form(apart, np.linalg.inv(covariance[keep])) > _APART2).all():
            keep.append(i)
    return keep


def _with_valley(
    problem: _Problem, tried: Matrix, *, answers: Gaussian, search: Search
) -> Gaussian:
    """Answers, and places between and beside them that the readings allow: valleys are curved.

    Each place is held near a point of the grid while the rest of its state is fitted.
    """
    d = search.lower.size
    near = _NEAR * search.size_m
    anchor = np.concatenate([np.full(d, near**-2.0), np.zeros(d)])
    weight = problem.weight + anchor
    mean = (problem.weight * problem.mean + anchor * tried) / weight
    states, _ = _refined(_Problem(problem.window, mean, weight), tried, steps=4)
    cost = _cost(problem, states)
    limit = float(_cost(problem, answers.mean[:1])[0]) + _ALLOWED
    taken = list(answers.mean)
    for i in np.argsort(cost, kind="stable").tolist():
        if cost[i] > limit or len(taken) == _VALLEY:
            break
        apart = np.linalg.norm(np.array(taken)[:, :d] - states[i, :d], axis=1)
        if (apart > 1.5 * near).all():
            taken.append(states[i])
    if len(taken) == len(answers.mean):
        return answers
    places = np.array(taken)
    told, _ = _normal(problem, places)
    return Gaussian(places, symmetric(np.linalg.inv(told + np.diag(weight))))


def _moves(problem: _Problem, state: Vector, search: Search) -> bool:
    """Whether a place follows at all: because the target clearly moves, or from bearings."""
    d = search.lower.size
    rest = np.concatenate([state[:d], np.zeros(d)])
    if misfit(problem.window, rest) > misfit(problem.window, state) + _MOVES:
        return True
    return _determined(_normal(problem, rest[None])[0][0], search)


def _determined(told: Matrix, search: Search) -> bool:
    """Whether the readings alone fix the place to a part of the box, and the velocity at all."""
    d = search.lower.size
    scale = np.repeat([_DETERMINED * search.size_m, search.speed_m_s], d)
    roots = np.linalg.eigvalsh(told * scale[:, None] * scale)
    return bool(roots[0] > 1.0)
