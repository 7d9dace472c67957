"""Pham, Table 2.1 and Figs. 2.5, 2.11: who measures and is awake, what they spend, the error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.experiments import pham_passage
from trackfield.experiments.pham_passage import SIDE_M, Hearing, Passage
from trackfield.network.energy import Energy, network_power
from trackfield.scheduling.activation import Zone
from trackfield.types import Gaussian, Matrix, Vector

SIGMA_M = 0.2  # of a range, as the text says of its scenarios 3 and 5
UNEXPLAINED_MW = 56e3  # what Table 2.1 shows above (2.31), in every row
RATIO = 1.8  # R_2 over R_a, if it is one for all rows
HALF_ANGLE = math.radians(36.0)
SCATTERED = (3.4, 15.7, 59.5, 127.2, 259.7)  # mean counts of Fig. 2.11
_KNOWN_M2 = 1e-4  # variance of a start that is "the same as the true value"
TRUE_START = Gaussian(np.zeros(2), _KNOWN_M2 * np.eye(2))


class Printed(NamedTuple):
    """A row of Table 2.1: mean counts, error variances [m^2], power [mW]; and its radii [m].

    The paper prints no radii. R_a follows from the first count; R_1 = 1.5 R_a is assumed; R_2 is
    then what the second count asks for, at a sector of +-36 deg.
    """

    measured: float
    active: float
    plain_m2: float
    kalman_m2: float
    power_mw: float
    measuring_m: float
    far_m: float

    @property
    def zone(self) -> Zone:
        """The region R of this row."""
        return zone(self.measuring_m, self.far_m)


PRINTED = (
    Printed(4.5, 9.3, 24.71e-3, 3.63e-3, 1.38e5, 0.576, 1.005),
    Printed(17.5, 39.2, 13.49e-3, 1.57e-3, 2.09e5, 1.211, 2.175),
    Printed(60.4, 139.9, 7.03e-3, 0.98e-3, 4.48e5, 2.418, 4.311),
    Printed(130.8, 275.5, 4.62e-3, 0.31e-3, 7.88e5, 3.610, 6.132),
    Printed(279.1, 416.2, 5.43e-3, 0.10e-3, 12.60e5, 5.637, 10.112),
)


class Found(NamedTuple):
    """A row of Table 2.1 here: as `Printed`, and `ranges_m2` of our filter on the ranges.

    `same_ratio` is the mean count in R where R_2 = 1.8 R_a, one ratio for all rows; `cycle_mw` (k,)
    is the power of each cycle.
    """

    measured: float
    active: float
    same_ratio: float
    plain_m2: float
    kalman_m2: float
    ranges_m2: float
    cycle_mw: Vector

    @property
    def power_mw(self) -> float:
        """Mean power of a cycle."""
        return float(self.cycle_mw.mean())


class Case(NamedTuple):
    """A passage, who measures in it, and the noise of their ranges [m]."""

    way: Passage
    who: Hearing
    sigma_m: float


class Estimates(NamedTuple):
    """Coordinates along x (r, k) [m] of runs: fixes, Pham's filter on them, ours on the ranges."""

    plain: Matrix
    kalman: Matrix
    ranges: Matrix


class Scattered(NamedTuple):
    """Fig. 2.11: nodes anywhere (n, 2) [m], power (5, k) [mW] of each cycle at five radii.

    `blind` (5,) is the share of cycles in which fewer than three nodes measure.
    """

    nodes: Matrix
    cycle_mw: Matrix
    blind: Vector


def zone(measuring_m: float, far_m: float) -> Zone:
    """Region R of nodes that measure within `measuring_m`: R_1 is half as far again."""
    return Zone(1.5 * measuring_m, far_m, HALF_ANGLE)


def rows(way: Passage, nodes: Matrix, *, runs: int, rng: np.random.Generator) -> tuple[Found, ...]:
    """Run every row of Table 2.1, its errors over `runs` draws of the noise."""
    cases = [
        Case(way, pham_passage.hearing(way, nodes, row.measuring_m), SIGMA_M) for row in PRINTED
    ]
    errors = [error_variances(way, one) for one in estimates(cases, runs=runs, rng=rng)]
    found: list[Found] = []
    for printed, case, three in zip(PRINTED, cases, errors, strict=True):
        measuring = case.who.heard.sum(axis=1)
        usual = zone(printed.measuring_m, RATIO * printed.measuring_m)
        inside, usually = (
            pham_passage.awake(way, nodes, region).sum(axis=1) for region in (printed.zone, usual)
        )
        plain, kalman, ours = three
        found.append(
            Found(
                measured=float(measuring.mean()),
                active=float(inside.mean()),
                same_ratio=float(usually.mean()),
                plain_m2=plain,
                kalman_m2=kalman,
                ranges_m2=ours,
                cycle_mw=_power(measuring, inside, len(nodes)),
            )
        )
    return tuple(found)


def estimates(cases: Sequence[Case], *, runs: int, rng: np.random.Generator) -> list[Estimates]:
    """Track each passage `runs` times in all three ways, from starts that are true."""
    plain: list[Matrix] = []
    variance: list[Matrix] = []
    ours: list[Matrix] = []
    plane = Gaussian(np.array([0.0, SIDE_M / 2.0, 0.0, 0.0]), _KNOWN_M2 * np.eye(4))
    for way, who, sigma_m in cases:
        ranges = pham_passage.measure(who, sigma_m=sigma_m, runs=runs, rng=rng)
        fixes = pham_passage.trilaterate(who, ranges, sigma_m=sigma_m)
        plain.append(fixes.position[..., 0])
        variance.append(fixes.covariance[None, :, 0, 0])
        found = pham_passage.on_ranges(way, who, ranges, sigma_m=sigma_m, start=plane)
        ours.append(found[..., 0])
    kalman = pham_passage.along_x(np.array(plain), np.array(variance), start=TRUE_START)
    return [Estimates(*three) for three in zip(plain, kalman, ours, strict=True)]


def deviations(way: Passage, nodes: Matrix, sigma_m: float) -> Vector:
    """Deviation (5,) [m] along x of trilateration in every row, exact: the root of mean Theta."""
    found: list[float] = []
    for row in PRINTED:
        who = pham_passage.hearing(way, nodes, row.measuring_m)
        fixes = pham_passage.trilaterate(who, who.distance[None], sigma_m=sigma_m)
        found.append(float(np.sqrt(fixes.covariance[:, 0, 0].mean())))
    return np.array(found)


def error_variances(way: Passage, found: Estimates) -> tuple[float, float, float]:
    """Variance [m^2] of the error along x over the cycles with a value, mean over the runs."""
    errors = (x - way.position[:, 0] for x in found)
    plain, kalman, ours = (float(np.nanvar(e, axis=1).mean()) for e in errors)
    return plain, kalman, ours


def scattered(way: Passage, rng: np.random.Generator) -> Scattered:
    """Compute the power of every cycle among nodes anywhere, at the mean counts of Fig. 2.11."""
    nodes = pham_passage.scattered(rng)
    apart = pham_passage.distances(way, nodes)
    power: list[Vector] = []
    blind: list[float] = []
    for count in SCATTERED:
        radius = pham_passage.radius_for(apart, count)
        measuring = np.count_nonzero(apart <= radius, axis=1)
        inside = pham_passage.awake(way, nodes, zone(radius, RATIO * radius)).sum(axis=1)
        power.append(_power(measuring, inside, len(nodes)))
        blind.append(np.count_nonzero(measuring < pham_passage.NEEDED) / len(measuring))
    return Scattered(nodes, np.array(power), np.array(blind))


def _power(measuring: NDArray[np.intp], inside: NDArray[np.intp], nodes: int) -> Vector:
    """Power (k,) [mW] of every cycle, Pham (2.31) and what his table shows above it."""
    warned = inside - measuring
    return network_power(
        Energy(), nodes, measuring=measuring, warned=warned, constant_mw=UNEXPLAINED_MW
    )
