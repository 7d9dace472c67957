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

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import ConfigurationError
from trackfield.linalg import solve
from trackfield.scheduling.cheapest import MOST, Choice, cheapest
from trackfield.sensing.range import RangeModels
from trackfield.sensing.range_outlook import gains, nearness, outlook, standing
from trackfield.types import Gaussian, Matrix, Vector


@dataclass(frozen=True, slots=True)
class Care:
    """How much is kept in reserve.

    `edge_sigmas`: a sensor is asked if its range reaches this many standard deviations beyond the
    predicted target; `near_sigmas`: and if the target is this many of them (across the line of
    sight) away; `aim`: share of the bound that is aimed at, because what is predicted is the
    optimum of a linear filter; `most`: sensors asked at a time.
    """

    edge_sigmas: float = 2.0
    near_sigmas: float = 2.5
    aim: float = 0.85
    most: int = MOST

    def __post_init__(self) -> None:
        """Refuse what cannot be kept."""
        problems = [
            f"care: found {name} {value:g}, expected {words}"
            for name, value, good, words in (
                ("edge_sigmas", self.edge_sigmas, self.edge_sigmas >= 0.0, "at least 0"),
                ("near_sigmas", self.near_sigmas, self.near_sigmas >= 0.0, "at least 0"),
                ("aim", self.aim, 0.0 < self.aim <= 1.0, "more than 0, at most 1"),
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
    the sharpest one is chosen; it is feasible if it keeps the bound itself.
    """
    d = sensors.shape[-1]
    place = standing(prior, d)
    seen = outlook(models, sensors, position=place)
    reaches = seen.distance + care.edge_sigmas * seen.along <= np.asarray(models.max_range_m)
    sure = reaches & (nearness(seen) >= care.near_sigmas) & np.isfinite(weights)
    choice = cheapest(
        solve(place.covariance, np.eye(d)).value,
        gains(seen),
        weights=np.where(sure, weights, np.inf),
        bound=care.aim * np.asarray(bound_m2),
        most=care.most,
    )
    return Asked(choice._replace(feasible=choice.trace <= bound_m2), sure)
