"""Pham, Figs. 2.6-2.10: error against speed and noise, single runs, masters told nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.experiments import pham_masters, pham_passage, pham_table21
from trackfield.experiments.pham_masters import Reign, Rule
from trackfield.experiments.pham_passage import SIDE_M, Passage
from trackfield.experiments.pham_table21 import PRINTED, SIGMA_M, Case
from trackfield.types import Gaussian, Matrix, Vector

_STRANGER = Gaussian(np.array([SIDE_M / 2.0, 0.0]), np.diag([SIDE_M**2 / 4.0, 1.0]))
"""What a master believes that was told nothing: the middle of the field, at rest."""


PLENTY_J = 20000.0  # a battery that a passage does not touch: masters change by distance only


class Setting(NamedTuple):
    """A point of a sweep: `value` as it is shown, noise of ranges [m], the passage."""

    value: float
    sigma_m: float
    way: Passage


class Sweep(NamedTuple):
    """Deviation [m] of the error along x against settings (j,): of fixes, Pham's filter, ours."""

    setting: Vector
    plain_m: Vector
    kalman_m: Vector
    ranges_m: Vector


class Traces(NamedTuple):
    """Coordinates along x (k,) [m] of one run; `begins` (k,) where a filter began anew."""

    way: Passage
    plain: Vector
    kalman: Vector
    begins: NDArray[np.bool_]


class HandOvers(NamedTuple):
    """One passage of masters: RMSE [m] of Pham's filter if its state travels, and if not."""

    margin: float
    reign: Reign
    shared_m: float
    alone_m: float


def sweep(
    settings: Sequence[Setting], mean_count: float, *, runs: int, rng: np.random.Generator
) -> Sweep:
    """Track passages in which `mean_count` nodes of the square field measure on average."""
    nodes = pham_passage.square()
    cases: list[Case] = []
    for _, sigma_m, way in settings:
        radius = pham_passage.radius_for(pham_passage.distances(way, nodes), mean_count)
        cases.append(Case(way, pham_passage.hearing(way, nodes, radius), sigma_m))
    found = pham_table21.estimates(cases, runs=runs, rng=rng)
    errors = [
        pham_table21.error_variances(case.way, one) for case, one in zip(cases, found, strict=True)
    ]
    return Sweep(np.array([s.value for s in settings]), *np.sqrt(np.array(errors).T))


def traces(
    way: Passage,
    mean_count: float,
    *,
    sigma_m: float = SIGMA_M,
    alone: bool = False,
    rng: np.random.Generator,
) -> Traces:
    """Track one passage over the square field; `alone`: no master tells the next, Fig. 2.9.

    Masters are then chosen by Pham 2.4 with full batteries (`pham_masters.Rule`).
    """
    nodes = pham_passage.square()
    radius = pham_passage.radius_for(pham_passage.distances(way, nodes), mean_count)
    who = pham_passage.hearing(way, nodes, radius)
    ranges = pham_passage.measure(who, sigma_m=sigma_m, runs=1, rng=rng)
    fixes = pham_passage.trilaterate(who, ranges, sigma_m=sigma_m)
    if alone:
        region = pham_table21.zone(radius, pham_table21.RATIO * radius)
        rule = Rule(margin=0.0, battery_j=PLENTY_J)
        found = pham_masters.reign(way, nodes, measuring_m=radius, zone=region, rule=rule)
        start, begins = _STRANGER, found.begins
    else:
        start, begins = pham_table21.TRUE_START, np.zeros(len(way.t_s), np.bool_)
    plain, variance = fixes.position[0, :, 0], fixes.covariance[:, 0, 0]
    x = pham_passage.along_x(plain, variance, start=start, begins=begins)
    return Traces(way, plain, x, begins)


def hand_overs(
    way: Passage, nodes: Matrix, *, reigns: Sequence[tuple[float, Reign]], runs: int,
    rng: np.random.Generator,
) -> tuple[HandOvers, ...]:  # fmt: skip
    """Track one passage with the radii of the first row, on the same ranges for every reign.

    `reigns` are masters of that passage, each with its margin.
    """
    row = PRINTED[0]
    who = pham_passage.hearing(way, nodes, row.measuring_m)
    ranges = pham_passage.measure(who, sigma_m=SIGMA_M, runs=runs, rng=rng)
    fixes = pham_passage.trilaterate(who, ranges, sigma_m=SIGMA_M)
    plain, variance = fixes.position[..., 0], fixes.covariance[None, :, 0, 0]

    def rmse(begins: NDArray[np.bool_] | None) -> float:
        x = pham_passage.along_x(plain, variance, start=_STRANGER, begins=begins)
        return float(np.sqrt(np.mean((x - way.position[:, 0]) ** 2)))

    shared = rmse(None)
    return tuple(HandOvers(margin, one, shared, rmse(one.begins)) for margin, one in reigns)


def first_row_reign(way: Passage, nodes: Matrix, rule: Rule) -> Reign:
    """Choose masters over a passage with the radii of the first row of Table 2.1."""
    row = PRINTED[0]
    return pham_masters.reign(way, nodes, measuring_m=row.measuring_m, zone=row.zone, rule=rule)
