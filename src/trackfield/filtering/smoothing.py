"""Smoothing: what later readings say about earlier states. Rauch, Tung and Striebel.

All functions take leading axes, like `filtering.kalman`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackfield.filtering.matrices import apply, symmetric, transposed
from trackfield.types import Gaussian, Matrix


class Passed(NamedTuple):
    """One step of a filter: belief `posterior` carried by `transition` became `prior`, next."""

    posterior: Gaussian
    transition: Matrix
    prior: Gaussian


class Lag(NamedTuple):
    """The last steps of a filter, oldest first: state of `step`."""

    passed: tuple[Passed, ...] = ()


def back(later: Gaussian, passed: Passed) -> Gaussian:
    """Smooth the state before a step, given the smoothed state after it.

    G = P F' P_-^-1; mean + G (later - prior), P + G (P_later - P_-) G'.
    """
    mean, P = passed.posterior
    G = transposed(np.linalg.solve(passed.prior.covariance, passed.transition @ P))
    smoothed = mean + apply(G, later.mean - passed.prior.mean)
    gained = G @ (later.covariance - passed.prior.covariance) @ transposed(G)
    return Gaussian(smoothed, symmetric(P + gained))


def smooth(last: Gaussian, passed: Sequence[Passed]) -> list[Gaussian]:
    """Smooth a whole run: beliefs of times 0..K from the K steps `passed` and the last belief."""
    smoothed = [last]
    for one in reversed(passed):
        smoothed.append(back(smoothed[-1], one))
    return smoothed[::-1]


def step(state: Lag, passed: Passed, *, now: Gaussian, lag: int) -> tuple[Lag, Gaussian | None]:
    """Take one more step of a filter; return the belief of `lag` steps ago given all until `now`.

    `passed` led from the last belief to the prior of `now`. None until `lag` steps were taken;
    lag 0 is `now` itself.
    """
    kept = (*state.passed, passed)[-lag:] if lag > 0 else ()
    if len(kept) < lag:
        return Lag(kept), None
    belief = now
    for one in reversed(kept):
        belief = back(belief, one)
    return Lag(kept), belief
