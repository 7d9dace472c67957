"""A soft bound: how well the target will be known, not how well a snapshot would locate it.

Pham bounds the covariance of a snapshot of three sensors. What a filter knows counts too: the bound
is on the trace of the PREDICTED POSTERIOR covariance of the position, and none, one, two or three
sensors keep it. That is another service, with about half the energy and half as much error again.

Two things make a linear prediction honest. What is believed of the target may be wrong by a few
standard deviations: a sensor whose range ends there, or which stands so near that it cannot tell on
which side the target is, is not asked. And a range of an uncertain target is curved
(`sensing.range_outlook`), which costs information.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import ConfigurationError, InputError
from trackfield.linalg import solve
from trackfield.scheduling.cheapest import MOST, Choice, cheapest
from trackfield.sensing.range import RangeModels
from trackfield.sensing.range_outlook import Outlook, gains, nearness, outlook, standing
from trackfield.types import Gaussian, Matrix, Vector

_CHEAP = 3  # the reading by which others are priced, in order of cost


@dataclass(frozen=True, slots=True)
class Care:
    """How much is kept in reserve.

    `edge_sigmas`: a sensor is asked if its range reaches this many standard deviations beyond the
    predicted target; `near_sigmas`: and if the target is this many of them (across the line of
    sight) away. Where the bound is not kept so, `least_edge_sigmas`, `least_near_sigmas` will do.
    `aim`: share of the bound that is aimed at, because what is predicted is the optimum of a linear
    filter; `thrift`: a sharper result saves readings later, and to get from the bound to nothing
    would be worth so many cheap ones; `most`: sensors asked at a time.
    """

    edge_sigmas: float = 2.0
    near_sigmas: float = 2.5
    least_edge_sigmas: float = 1.5
    least_near_sigmas: float = 1.0
    aim: float = 0.93
    thrift: float = 2.0
    most: int = MOST

    def __post_init__(self) -> None:
        """Refuse what cannot be kept."""
        problems = [
            f"care: found {name} {value}, expected {words}"
            for name, value, good, words in (
                ("edge_sigmas", self.edge_sigmas, self.edge_sigmas >= 0.0, "at least 0"),
                ("near_sigmas", self.near_sigmas, self.near_sigmas >= 0.0, "at least 0"),
                (
                    "least_edge_sigmas",
                    self.least_edge_sigmas,
                    0.0 <= self.least_edge_sigmas <= self.edge_sigmas,
                    "0 to edge_sigmas",
                ),
                (
                    "least_near_sigmas",
                    self.least_near_sigmas,
                    0.0 <= self.least_near_sigmas <= self.near_sigmas,
                    "0 to near_sigmas",
                ),
                ("aim", self.aim, 0.0 < self.aim <= 1.0, "more than 0, at most 1"),
                ("thrift", self.thrift, 0.0 <= self.thrift < math.inf, "at least 0"),
                ("most", self.most, 1 <= self.most <= MOST, f"1 to {MOST}"),
            )
            if not good
        ]
        if problems:
            raise ConfigurationError(problems)


class Asked(NamedTuple):
    """A `choice`, and which of the sensors would surely hear the target, `sure` (..., n)."""

    choice: Choice
    sure: NDArray[np.bool_]


def choose(
    prior: Gaussian,
    sensors: Matrix,
    *,
    models: RangeModels,
    bound_m2: float | Vector,
    weights: Vector,
    care: Care = Care(),
) -> Asked:
    """Cheapest sensors whose readings will leave a position with tr P <= bound, the prior counted.

    `prior` is the belief predicted to the time of the readings, with leading axes for targets or
    runs; its states begin with the position. `sensors` (..., n, d) [m] have ranges as `models` say,
    and reach as far as these say; `weights` (..., n) are what a reading of each costs (by its
    residual energy, say), infinite if it cannot be asked. If no set gets to `aim` times the bound,
    the sharpest one is chosen; it is feasible if it keeps the bound itself, which is positive.
    """
    if not (np.asarray(bound_m2) > 0.0).all():
        raise InputError("found a bound that is not positive, expected one [m^2]")
    d = sensors.shape[-1]
    place = standing(prior, d)
    information = solve(place.covariance, np.eye(d)).value
    seen = outlook(models, sensors, position=place)

    def attempt(edge: float, near: float) -> Asked:
        sure = _sure(seen, models, edge, near) & np.isfinite(weights)
        able = np.where(sure, weights, np.inf)
        choice = cheapest(
            information,
            gains(seen),
            weights=able,
            bound=care.aim * np.asarray(bound_m2),
            worth=_worth(able, bound_m2, care),
            limits=(0, care.most),
        )
        return Asked(choice._replace(feasible=choice.trace <= bound_m2), sure)

    asked = attempt(care.edge_sigmas, care.near_sigmas)
    if asked.choice.feasible.all():
        return asked
    return _sharper(asked, attempt(care.least_edge_sigmas, care.least_near_sigmas))


def _sure(seen: Outlook, models: RangeModels, edge: float, near: float) -> NDArray[np.bool_]:
    reaches = seen.distance + edge * seen.along <= np.asarray(models.max_range_m)
    return reaches & (nearness(seen) >= near)


def _sharper(first: Asked, second: Asked) -> Asked:
    """Take the second attempt where the first did not keep the bound."""
    failed = ~first.choice.feasible
    parts = (
        np.where(failed[..., None] if a.ndim > failed.ndim else failed, b, a)
        for a, b in zip(first.choice, second.choice, strict=True)
    )
    return Asked(Choice(*parts), np.where(failed[..., None], second.sure, first.sure))


def _worth(weights: Vector, bound_m2: float | Vector, care: Care) -> Vector:
    """Price of a sharper result [1/m^2]: thrift times the third cheapest reading over the bound."""
    place = min(_CHEAP, weights.shape[-1]) - 1
    if place < 0 or care.thrift == 0.0:
        return np.zeros(weights.shape[:-1])
    cheap = np.partition(weights, place, axis=-1)[..., place]
    return care.thrift * np.where(np.isfinite(cheap), cheap, 0.0) / np.asarray(bound_m2)
