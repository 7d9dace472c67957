"""Tracking under a soft bound: ask few sensors, hear them, find the target again when it is lost.

A filter that asks one sensor a step believes its covariance even when it has lost the target, and
then asks the wrong ones. Three signs tell: a sensor that surely hears is silent; what is heard does
not fit; nobody surely hears any more. Then the belief is weighed anew with all that was heard and
was not (`filtering.gridded`), which makes it as wide as it must be; and while it is so wide that
fewer than three sensors would surely hear, a net of more of them is cast (`search_net`), wider from
look to look. In the plane.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import ConfigurationError
from trackfield.filtering import gridded, second_order
from trackfield.filtering.gridded import Answers, Doubt
from trackfield.linalg import gate
from trackfield.raster import Region
from trackfield.scheduling import search_net
from trackfield.scheduling.cheapest import MOST, Choice
from trackfield.scheduling.soft_bound import Asked, Care, choose
from trackfield.sensing.range import RangeModel
from trackfield.sensing.range_outlook import standing
from trackfield.types import Gaussian, Indices, Matrix, Vector

_ENOUGH = 3  # sensors that surely hear: with fewer, a net is cast
_LOST = 4.0  # times the bound: a predicted trace that large is a target as good as lost
_WIDER = 2.0  # times the covariance, when nobody heard anything


class Rule(Protocol):
    """How sensors are chosen while the target is not lost; `soft_bound.choose` is one."""

    def __call__(
        self,
        prior: Gaussian,
        sensors: Matrix,
        *,
        models: RangeModel,
        bound_m2: float | Vector,
        weights: Vector,
        care: Care,
    ) -> Asked:
        """Choose for beliefs of runs, means (r, n)."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Service:
    """What is promised, with which sensors, and how it is kept.

    tr P <= `bound_m2` (a number, or one a run) for sensors of one kind, `models`; `care` of the
    choice, more of it since one sensor a step must do; readings that fit with less than 1 - `gate`
    are suspicious; `nets` are the most sensors that the first, second, ... look of a search wakes;
    targets are in the `field`, if it is told.
    """

    models: RangeModel
    bound_m2: float | Vector
    care: Care = Care(near_sigmas=3.0)  # noqa: RUF009 (immutable)
    gate: float = 0.998
    nets: tuple[int, ...] = (8, 12, 18, 24)
    doubt: Doubt = Doubt()  # noqa: RUF009 (immutable)
    field: Region | None = None

    def __post_init__(self) -> None:
        """Refuse what cannot be promised."""
        problems = [
            f"service: found {name} {value}, expected {words}"
            for name, value, good, words in (
                ("bound_m2", self.bound_m2, bool(np.all(self.bound_m2 > 0.0)), "more than 0"),
                ("gate", self.gate, 0.0 < self.gate < 1.0, "between 0 and 1"),
                (
                    "nets",
                    self.nets,
                    min(self.nets, default=0) > 0,
                    "one or more, of 1 sensor or more",
                ),
            )
            if not good
        ]
        if problems:
            raise ConfigurationError(problems)


class State(NamedTuple):
    """Beliefs of r runs: means (r, n), covariances (r, n, n); `missed` (r,) looks in a row."""

    belief: Gaussian
    missed: Indices


class Request(NamedTuple):
    """Who is asked: `sensors` (r, m), -1 where nobody; of the `choice`, or of a net (`searching`).

    What a search costs is in nobody's choice: `choice.cost` is zero there.
    """

    sensors: Indices
    choice: Choice
    searching: NDArray[np.bool_]


class Info(NamedTuple):
    """What came of it: `kept` (r,), tr P <= bound; `doubted` (r,) beliefs were weighed anew."""

    kept: NDArray[np.bool_]
    doubted: NDArray[np.bool_]
    distance2: Vector


def init(belief: Gaussian) -> State:
    """Begin with beliefs of runs, means (r, n) and covariances (r, n, n)."""
    return State(belief, np.zeros(len(belief.mean), np.int32))


def ask(
    predicted: State,
    sensors: Matrix,
    *,
    service: Service,
    weights: Vector,
    rule: Rule = choose,
) -> Request:
    """Sensors to ask about targets that are predicted to now, out of `sensors` (r, n, 2) [m].

    `weights` (r, n) are what a reading of each costs, infinite if it cannot be asked. The choice is
    that of the soft bound, or of another `rule`.
    """
    belief = predicted.belief
    choice, sure = rule(
        belief,
        sensors,
        models=service.models,
        bound_m2=service.bound_m2,
        weights=weights,
        care=service.care,
    )
    lost = (predicted.missed > 0) | (choice.trace > _LOST * np.asarray(service.bound_m2))
    searching = lost & (sure.sum(axis=-1) < _ENOUGH)
    if not searching.any():
        return Request(choice.sensors, choice, searching)
    place = standing(belief, 2)
    asked = np.full((len(sensors), max(MOST, *service.nets)), -1, np.int32)
    asked[:, :MOST] = np.where(searching[:, None], -1, choice.sensors)
    for run in np.flatnonzero(searching):
        wanted = search_net.places(Gaussian(place.mean[run], place.covariance[run]), service.field)
        look = min(int(predicted.missed[run]), len(service.nets) - 1)
        net = search_net.cast(
            sensors[run],
            wanted,
            reach_m=service.models.max_range_m,
            able=np.isfinite(weights[run]),
            most=service.nets[look],
        )
        asked[run, : len(net)] = net
    unpaid = choice._replace(
        cost=np.where(searching, 0.0, choice.cost), feasible=choice.feasible & ~searching
    )
    return Request(asked, unpaid, searching)


def hear(
    predicted: State, request: Request, z: Matrix, *, sensors: Matrix, service: Service
) -> tuple[State, Info]:
    """Condition on what the asked sensors heard, `z` (r, m) [m], NaN for silence."""
    asked = request.sensors >= 0
    rows = np.arange(len(asked))[:, None]
    at = sensors[rows, np.maximum(request.sensors, 0)]
    heard = asked & ~np.isnan(z)
    few = slice(None, MOST)
    ordinary = np.where(heard & ~request.searching[:, None], z, np.nan)[:, few]
    updated = second_order.update(predicted.belief, ordinary, at[:, few], models=service.models)
    limit = gate(service.gate, np.maximum(updated.readings, 1.0))
    odd = (updated.readings > 0) & (updated.distance2 > limit)
    doubted = request.searching | odd | (asked & ~heard).any(axis=1)
    mean, covariance = (part.copy() for part in updated.posterior)
    for run in np.flatnonzero(doubted):
        prior = Gaussian(predicted.belief.mean[run], predicted.belief.covariance[run])
        told = Answers(at[run, heard[run]], z[run, heard[run]], at[run, asked[run] & ~heard[run]])
        mean[run], covariance[run] = _weighed(prior, told, service)
    unheard = doubted & ~heard.any(axis=1)
    state = State(Gaussian(mean, covariance), np.where(unheard, predicted.missed + 1, 0))
    trace = np.trace(covariance[:, :2, :2], axis1=1, axis2=2)
    return state, Info(trace <= service.bound_m2, doubted, updated.distance2)


def _weighed(prior: Gaussian, told: Answers, service: Service) -> Gaussian:
    belief = gridded.update(
        prior, told, models=service.models, doubt=service.doubt, field=service.field
    )
    if len(told.z):
        return belief
    limit = service.doubt.limit_m**2 / float(np.trace(belief.covariance[:2, :2]))
    return belief._replace(covariance=max(1.0, min(_WIDER, limit)) * belief.covariance)
