"""Pham, Fig. 5.4: filters that begin 1.5 m wrong, and how soon they find a crossing target."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.experiments import pham_passage
from trackfield.experiments.pham_passage import CYCLE_S, Hearing
from trackfield.experiments.results import Table
from trackfield.filtering import extended, kalman
from trackfield.filtering.extended import Iteration, Ranges
from trackfield.motion import ConstantVelocity
from trackfield.scheduling.cost import energy_cost, inverse
from trackfield.scheduling.lifetime_candidates import Need, candidates, cheapest, sharpest
from trackfield.sensing.range import RangeModel
from trackfield.types import Gaussian, Indices, Matrix, Vector

SIGMA_M = 0.1
NEED = Need(3.0 * SIGMA_M**2)
REACH_M = 1.4
STATE_SIGMA = 0.005  # of Pham's filter, a cycle
TRUE_M, BELIEVED_M = 9.5, 8.0  # x at the beginning
NEAR_M = 0.1 * (TRUE_M - BELIEVED_M)  # an error that is "greatly reduced"
SETTLED_S = 1.0
ACCEL_DENSITY = 0.1  # [m^2/s^3] of our filter, as in chapter 2; the best of five on other fields
PAPER_SETTLE_S = 0.3

ALONE = "trilateration alone"
SURE = "Pham's filter, sure of its start"
UNSURE = "Pham's filter, start sigma 1.5 m"
OURS = "ours, on ranges, start sigma 1.5 m"


class Started(NamedTuple):
    """Errors along x [m] by estimate, (runs, cycles) each, of one rule of who senses.

    By cycle (k,): `trace` [m^2] of the snapshot's covariance that the ranges allow, and
    `fix_sigma_m` [m], the deviation along x of what trilateration makes of them.
    """

    errors: dict[str, Matrix]
    trace: Vector
    fix_sigma_m: Vector


class StartResult(NamedTuple):
    """Fig. 5.4: `t_s` (k,), the target's `x` (k,) [m], nodes of least trace and of least cost."""

    t_s: Vector
    x: Vector
    sharpest: Started
    cheapest: Started


def start(
    sensors: Matrix, rng: np.random.Generator, *, runs: int = 16, cycles: int = 2000
) -> StartResult:
    """Cross a field of `sensors` (n, 2) [m] from right to left, three nodes a cycle of 5 ms.

    x = 9.5 - .9 t, y = 5 + 3 sin(2 pi x / 10). Who senses is chosen at the true position; nodes
    hold random energies of 1 to 30 sensings, as in Fig. 5.5.
    """
    t_s = CYCLE_S * np.arange(cycles, dtype=np.float64)
    x = TRUE_M - 0.9 * t_s
    way = np.column_stack([x, 5.0 + 3.0 * np.sin(2.0 * np.pi * x / 10.0)])
    near = candidates(sensors, way, sigma_m=SIGMA_M, reach_m=REACH_M)
    costs = energy_cost(rng.uniform(1.0, 30.0, len(sensors)), 0.5, price=inverse())
    least = sharpest(near, costs, need=NEED).chosen
    cheap = cheapest(near, costs, need=NEED).chosen
    cheap = np.where(cheap < 0, least, cheap)  # no set within the bound: the sharpest senses
    one, other = (follow(_hearing(sensors, way, s), way, runs, rng=rng) for s in (least, cheap))
    return StartResult(t_s, x, one, other)


def follow(who: Hearing, way: Matrix, runs: int, *, rng: np.random.Generator) -> Started:
    """Let every estimate work on the same ranges, from a start 1.5 m wrong; `way` (k, 2) [m]."""
    ranges = pham_passage.measure(who, sigma_m=SIGMA_M, runs=runs, rng=rng)
    fixes = pham_passage.trilaterate(who, ranges, sigma_m=SIGMA_M)
    fix_x, variance = fixes.position[..., 0], fixes.covariance[:, 0, 0]
    off = TRUE_M - BELIEVED_M
    mean = np.array([BELIEVED_M, 0.0])

    def filtered(covariance: Matrix) -> Matrix:
        begin = Gaussian(mean, covariance)
        return pham_passage.along_x(fix_x, variance, start=begin, state_sigma=STATE_SIGMA)

    found = {
        ALONE: fix_x,
        SURE: filtered(STATE_SIGMA**2 * np.eye(2)),
        UNSURE: filtered(np.diag([off**2, 1.0])),
        OURS: _on_ranges(
            who,
            ranges,
            Gaussian(
                np.array([BELIEVED_M, way[0, 1], 0.0, 0.0]), np.diag([off**2] * 2 + [4.0] * 2)
            ),
        ),
    }
    errors = {name: x - way[:, 0] for name, x in found.items()}
    return Started(errors, _traces(who, way), np.sqrt(variance))


def settle_s(errors: Matrix) -> float:
    """Time [s] at which the RMS of `errors` (r, k) over runs is first .15 m at most, or inf."""
    near = np.flatnonzero(np.sqrt(np.mean(errors**2, axis=0)) <= NEAR_M)
    return float(near[0] * CYCLE_S) if near.size else np.inf


def rmse_m(errors: Matrix) -> float:
    """RMS [m] of `errors` (r, k) from 1 s on, of the estimates there are."""
    late = errors[:, round(SETTLED_S / CYCLE_S) :]
    return float(np.sqrt(np.nanmean(late**2)))


def table(found: StartResult) -> Table:
    """Who senses, which estimate, how soon and how well."""
    senders = (("least trace", found.sharpest), ("least cost", found.cheapest))
    rows = tuple(
        (
            who,
            name,
            "about 0.3" if name == SURE else "",
            "" if name == ALONE else f"{settle_s(errors):.3f}",
            f"{rmse_m(errors):.4f}",
            f"{np.nanmedian(np.abs(errors)):.4f}",
        )
        for who, started in senders
        for name, errors in started.errors.items()
    )
    columns = (
        "who senses",
        "estimate",
        "near after, paper [s]",
        "near after [s]",
        f"RMSE from {SETTLED_S:g} s on [m]",
        "median error [m]",
    )
    return Table(f"Fig. 5.4: x begins {TRUE_M - BELIEVED_M:g} m wrong", columns, rows)


def findings(found: StartResult) -> tuple[str, ...]:
    """Say what the .3 s of the paper hang on, and which nodes serve better."""
    least, cheap = found.sharpest, found.cheapest
    sure, unsure = (settle_s(least.errors[name]) for name in (SURE, UNSURE))
    sigma = least.fix_sigma_m
    return (
        f"Fig. 5.4: Pham's filter that is sure of its wrong start (sigma {STATE_SIGMA:g} m, its "
        f"state noise) has a tenth of the error left after {sure:.2f} s (paper: about "
        f"{PAPER_SETTLE_S:g} s) with the nodes of least trace and after "
        f"{settle_s(cheap.errors[SURE]):.2f} s with those of least cost; one that is told 1.5 m, "
        f"as far as it is off, after {unsure:.3f} s. The paper gives no covariance of the start, "
        "nor which way the target goes: here from right to left, and without a first velocity.",
        f"From {SETTLED_S:g} s on, nodes of least cost have in Pham's filter "
        f"{_rmse(cheap, UNSURE, least):.2f} times the RMSE of those of least trace, in ours "
        f"{_rmse(cheap, OURS, least):.2f} times; ours has {_rmse(least, OURS, least, UNSURE):.2f} "
        f"(least trace) and {_rmse(cheap, OURS, cheap, UNSURE):.2f} (least cost) of that filter's. "
        "The paper calls the difference of nodes not significant. A filter sure of its wrong start "
        "still has a false speed then.",
        "Least trace is no promise for trilateration: three nodes on nearly one line can see the "
        f"target from good angles. Fixes deviate by {np.median(sigma):.2f} m along x in the median "
        f"cycle, by {sigma.max():.1f} m in the worst, where the ranges allow "
        f"{np.sqrt(least.trace.max(initial=0.0)):.2f} m in the plane. Such nodes leave a mirror "
        "image too, at which a filter on ranges may begin.",
    )


def _rmse(one: Started, name: str, other: Started, by: str | None = None) -> float:
    """RMSE of an estimate with some nodes over that with others, or over that of another."""
    return rmse_m(one.errors[name]) / rmse_m(other.errors[by or name])


def _hearing(sensors: Matrix, way: Matrix, chosen: Indices) -> Hearing:
    """Tell who measures, of sets (k, 3); -1 where there is none."""
    place = sensors[chosen]
    return Hearing(place, np.linalg.norm(way[:, None] - place, axis=-1), chosen >= 0)


def _traces(who: Hearing, way: Matrix) -> Vector:
    """Traces (k,) [m^2] of the ranges' own bound, in cycles where somebody measures."""
    senses = who.heard.all(axis=1)
    u = (way[senses, None] - who.place[senses]) / who.distance[senses, :, None]
    return SIGMA_M**2 * np.trace(np.linalg.inv(np.swapaxes(u, 1, 2) @ u), axis1=1, axis2=2)


def _on_ranges(who: Hearing, ranges: Matrix, begin: Gaussian) -> Matrix:
    """Ours: x (r, k) [m] of an iterated filter on ranges (r, k, m), [x, y, vx, vy]."""
    motion, model = ConstantVelocity(ACCEL_DENSITY), RangeModel(sigma_m=SIGMA_M)
    F, Q = motion.transition(CYCLE_S), motion.noise(CYCLE_S)
    once = Iteration(rounds=1)  # the noise does not depend on the range
    prior = Gaussian(*(np.broadcast_to(part, (len(ranges), *part.shape)) for part in begin))
    x = np.empty(ranges.shape[:2])
    for k, place in enumerate(who.place):
        found = extended.iterate(prior, ranges[:, k], Ranges(place, model), iteration=once)
        x[:, k] = found.update.posterior.mean[:, 0]
        prior = kalman.predict(found.update.posterior, F, Q)
    return x
