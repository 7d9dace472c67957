"""Pham, chapter 5: who senses under a hard bound on a snapshot, and how long that lasts."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trackfield.experiments import pham_start
from trackfield.experiments.pham_start import StartResult
from trackfield.experiments.results import Table, mean_interval
from trackfield.scheduling.chains import eliminate_collinear
from trackfield.scheduling.clairvoyant import first_death_bound, service_bound
from trackfield.scheduling.cost import energy_cost, inverse
from trackfield.scheduling.lifetime import Field, lifetime
from trackfield.scheduling.lifetime_candidates import Need, candidates
from trackfield.scheduling.lifetime_policies import POLICIES
from trackfield.scheduling.lifetime_search import SensorSet, optimum, rank_sum
from trackfield.types import Indices, Matrix, Vector

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIGMA_M = 0.1
NEED = Need(3.0 * SIGMA_M**2)
BATTERY = 30.0  # sensings
FIRST_FIELD = 9000  # seed
TIGHT = 1.345  # sigma^2: the bound at which Fig. 5.5's count of attempts comes out


class Choice(NamedTuple):
    """Fig. 5.3: `nodes` (20, 2) around `target`, `residual` (20,), those kept, and who senses."""

    target: Vector
    nodes: Matrix
    residual: Vector
    kept: Indices
    bounded: SensorSet
    cheapest: SensorSet


class Elimination(NamedTuple):
    """Fig. 5.5 along a sinusoid (steps,): nodes before and after, sets before, after, and tried."""

    path: Matrix
    before: Vector
    after: Vector
    sets_before: Vector
    sets_after: Vector
    tried: Vector


class Ranks(NamedTuple):
    """Cost of the rank-sum choice over the optimum's (draws,), over the same kept nodes."""

    excess: Vector


class Lives(NamedTuple):
    """By policy (fields,): `death` of the first node, `failed` share; and the bounds of both."""

    death: dict[str, Vector]
    failed: dict[str, Vector]
    death_bound: Vector
    failed_bound: Vector
    intervals: int


class LifetimeResult(NamedTuple):
    """What chapter 5 comes to; `sensors` (441, 2) [m] are those of Fig. 5.2."""

    sensors: Matrix
    choice: Choice
    elimination: Elimination
    ranks: Ranks
    lives: Lives
    started: StartResult
    rng: np.random.Generator


def run(rng: np.random.Generator, *, quick: bool = False) -> LifetimeResult:
    """Run Figs. 5.2-5.5, rank sums against optima, and lifetimes on fields of their own seeds."""
    sensors = rng.uniform(0.0, 10.0, (441, 2))
    return LifetimeResult(
        sensors,
        _choice(rng),
        _elimination(sensors, rng, steps=60 if quick else 400),
        _ranks(rng, draws=40 if quick else 400),
        _lives(fields=1 if quick else 2, passes=24 if quick else 200),
        pham_start.start(
            sensors, rng.spawn(1)[0], runs=4 if quick else 16, cycles=400 if quick else 2000
        ),
        rng,
    )


def crossings(rng: np.random.Generator, count: int) -> Matrix:
    """Sinusoids from left to right (count, 25, 2) [m]: y = m + a sin(2 pi t + phase).

    a in 1..3, m in 3..7, any phase: with a reach of 1.4 and 30 sensings a node, the first death by
    the logarithmic cost and its bound are those that are known (about 3250 and 3550 intervals).
    """
    t = np.linspace(0.0, 1.0, 25)
    amplitude, middle = rng.uniform(1.0, 3.0, (count, 1)), rng.uniform(3.0, 7.0, (count, 1))
    y = middle + amplitude * np.sin(2.0 * np.pi * t + rng.uniform(0.0, 2.0 * np.pi, (count, 1)))
    return np.stack([np.broadcast_to(10.0 * t, y.shape), y], axis=-1)


def tables(found: LifetimeResult) -> tuple[Table, ...]:
    """Tables of Figs. 5.4 and 5.5, and of lifetimes."""
    e, lives = found.elimination, found.lives
    rows = tuple(
        (what, paper, f"{values.mean():.1f}")
        for what, paper, values in (
            ("nodes in reach", "24.3", e.before),
            ("left without collinear ones", "6.1", e.after),
            ("sets to search", "2529", e.sets_before),
            ("sets left", "27.9", e.sets_after),
            ("sets tried", "19.5", e.tried),
        )
    )
    lived = [_row(name, found) for name in POLICIES]
    bound = (
        "nobody beyond",
        f"{lives.death_bound.mean():.0f}",
        "",
        "1",
        f"{100 * lives.failed_bound.mean():.1f} %",
    )
    columns = ("policy", "first death", "over geometry", "of the bound", "failed intervals")
    title = f"First node death of {lives.death_bound.size} fields [intervals of {lives.intervals}]"
    return (
        pham_start.table(found.started),
        Table("Fig. 5.5: collinear elimination, means", ("", "paper", "here"), rows),
        Table(title, columns, (*lived, bound)),
    )


def findings(found: LifetimeResult) -> tuple[str, ...]:
    """Say what holds of chapter 5, and what cannot be recovered."""
    c, excess, lives = found.choice, found.ranks.excess, found.lives
    learned = (lives.death["learned"] / lives.death_bound).mean()
    return (
        f"Fig. 5.3: the cheapest three nodes have a trace of {c.cheapest.trace / SIGMA_M**2:.2f} "
        f"sigma^2, those within 3 sigma^2 cost {c.bounded.cost / c.cheapest.cost:.2f} times as "
        "much. The paper's own powers and places are not printed, and its bound 5 sigma_V mixes "
        "units.",
        f"The rank sum costs {100 * excess.mean():.2f} % more than the optimum on average, "
        f"{100 * excess.max():.0f} % at most; Theorem 5.1 is false (it picks 104 where 58 is "
        "possible).",
        f"Fig. 5.5: so many sets are tried only under a bound just above the least possible trace, "
        f"4/3 sigma^2 (here {TIGHT:g}); at 3 sigma^2 the first one nearly always will do. The "
        "paper's own bound is not recoverable.",
        f"A policy that learns demand from past passes alone reaches {learned:.2f} of the bound "
        "that nobody can pass who knows all passes beforehand.",
        "First deaths over geometry alone hang on how often targets come to the same places, which "
        "the paper does not say; shares of the bound do not.",
        *pham_start.findings(found.started),
    )


def figures(found: LifetimeResult) -> dict[str, Figure]:
    """Draw Figs. 5.2-5.5 and the lifetimes, by file name without its suffix."""
    from trackfield.experiments.pham_lifetime_figures import figures as drawn

    return drawn(found)


def _row(name: str, found: LifetimeResult) -> tuple[str, ...]:
    lives = found.lives
    death, base = lives.death[name], lives.death["geometry"]
    return (
        name,
        mean_interval(death, found.rng).text(0),
        f"{death.mean() / base.mean():.2f}",
        mean_interval(death / lives.death_bound, found.rng).text(3),
        f"{100 * lives.failed[name].mean():.1f} %",
    )


def _choice(rng: np.random.Generator) -> Choice:
    """Draw 20 nodes of random energy within 2 of (4.3, 6.2), as in Fig. 5.3."""
    target = np.array([4.3, 6.2])
    angle, r = rng.uniform(0.0, 2.0 * np.pi, 20), 2.0 * np.sqrt(rng.random(20))
    nodes = target + r[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    residual = rng.uniform(1.0, BATTERY, 20)
    gains = (target - nodes) / (r[:, None] * SIGMA_M)
    kept = eliminate_collinear(gains, residual)
    costs = np.full(20, np.inf)
    costs[kept] = energy_cost(residual[kept], 0.5, price=inverse())
    return Choice(
        target,
        nodes,
        residual,
        kept.astype(np.int32),
        optimum(gains, costs, bound=NEED.bound_m2),
        optimum(gains, costs, bound=1e6),
    )


def _elimination(sensors: Matrix, rng: np.random.Generator, *, steps: int) -> Elimination:
    """Follow a sinusoid for 10 s and search at every step, nodes with random energies."""
    t = np.linspace(0.0, 1.0, steps)
    path = np.column_stack([10.0 * t, 5.0 + 3.0 * np.sin(2.0 * np.pi * t)])
    near = candidates(sensors, path, sigma_m=SIGMA_M, reach_m=1.4)
    residual = rng.uniform(1.0, BATTERY, len(sensors))
    costs = energy_cost(residual, 0.5, price=inverse())
    counts = np.zeros((steps, 3))
    for i in range(steps):
        a, b = near.offsets[i], near.offsets[i + 1]
        nodes, gains = near.nodes[a:b], near.gains[a:b]
        kept = eliminate_collinear(gains, residual[nodes])
        tried = rank_sum(gains[kept], costs[nodes[kept]], bound=TIGHT * SIGMA_M**2)
        counts[i] = b - a, kept.size, tried.attempts
    sets = [np.array([math.comb(int(n), 3) for n in counts[:, j]], float) for j in (0, 1)]
    return Elimination(path, counts[:, 0], counts[:, 1], sets[0], sets[1], counts[:, 2])


def _ranks(rng: np.random.Generator, *, draws: int) -> Ranks:
    """Compare rank sums with optima on 24 nodes around a target, all kept."""
    excess = np.zeros(draws)
    for i in range(draws):
        angle = rng.uniform(0.0, 2.0 * np.pi, 24)
        gains = np.column_stack([np.cos(angle), np.sin(angle)]) / SIGMA_M
        costs = energy_cost(rng.uniform(1.0, BATTERY, 24), 0.5, price=inverse())
        paper, best = (f(gains, costs, bound=NEED.bound_m2) for f in (rank_sum, optimum))
        excess[i] = paper.cost / best.cost - 1.0
    return Ranks(excess)


def _lives(*, fields: int, passes: int) -> Lives:
    """Let targets cross until batteries end; a quick run has batteries in proportion."""
    battery = max(np.floor(BATTERY * passes / 200.0), 3.0)
    death: dict[str, list[float]] = {name: [] for name in POLICIES}
    failed: dict[str, list[float]] = {name: [] for name in POLICIES}
    bounds: list[tuple[float, float]] = []
    for seed in range(FIRST_FIELD, FIRST_FIELD + fields):
        rng = np.random.default_rng(seed)
        field = Field(rng.uniform(0.0, 10.0, (441, 2)), SIGMA_M, 1.4, battery)
        paths, forecast = crossings(rng, passes), crossings(rng, passes)
        for name in POLICIES:
            life = lifetime(field, paths, need=NEED, chosen_by=name, forecast=forecast)
            death[name].append(float(life.first_death or paths.shape[0] * paths.shape[1]))
            failed[name].append(life.failed / (life.failed + life.served))
        near = candidates(field.sensors, paths, sigma_m=SIGMA_M, reach_m=1.4)
        full = np.full(441, battery)
        least = first_death_bound(near, full, need=NEED, rounds=2).interval or len(near)
        served = service_bound(near, full, need=NEED, rounds=1)
        bounds.append((float(least), served.failed / len(near)))
    both = np.array(bounds)
    return Lives(
        {name: np.array(values) for name, values in death.items()},
        {name: np.array(values) for name, values in failed.items()},
        both[:, 0],
        both[:, 1],
        25 * passes,
    )
