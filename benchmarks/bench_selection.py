"""Selection of sensors: 3 of 24 against a NumPy that looks at all sets, 6 of 2000 against a bound.

Times are processor time of a call through Python, the least over repeats, both sides in turn.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from trackfield.localization.information import reading_gains
from trackfield.scheduling.paper_selection import best_pair_and_next, function_2d
from trackfield.scheduling.selection import Selection, select
from trackfield.sensing.range import RangeModel
from trackfield.types import Indices, Matrix

FRESH = 70_000  # seeds that were used to choose nothing
EQUAL = RangeModel(sigma_m=0.1)
GROWING = RangeModel(sigma_m=0.1, sigma_scale=0.02)


def equal_ranges(rng: np.random.Generator, n: int, d: int = 2) -> Matrix:
    """Gains of ranges of equal noise: sensors anywhere in 100 m, the target in the middle part."""
    return reading_gains(EQUAL, rng.uniform(0, 100, (n, d)), rng.uniform(30, 70, d))


def growing_ranges(rng: np.random.Generator, n: int, d: int = 2) -> Matrix:
    """Gains of ranges whose noise grows with the distance."""
    return reading_gains(GROWING, rng.uniform(0, 100, (n, d)), rng.uniform(30, 70, d))


def anything(rng: np.random.Generator, n: int, d: int = 2) -> Matrix:
    """Gaussian gains: directions and strengths at random."""
    return rng.normal(size=(n, d))


FIELDS: dict[str, Callable[[np.random.Generator, int, int], Matrix]] = {
    "ranges, equal noise": equal_ranges,
    "ranges, growing noise": growing_ranges,
    "Gaussian gains": anything,
}


class AllSets:
    """NumPy's best: all sets of k at once, traces in closed form; plane only."""

    def __init__(self, n: int, k: int) -> None:
        self.sets = np.array(list(itertools.combinations(range(n), k)), np.int32)

    def __call__(self, g: Matrix) -> Indices:
        """Best set by trace."""
        xx, xy, yy = ((a * b)[self.sets].sum(1) for a, b in ((g.T[0], g.T[0]), g.T, (g.T[1],) * 2))
        return self.sets[np.argmin((xx + yy) / (xx * yy - xy**2))]


class Small(NamedTuple):
    """Selection of a few of a few: mean trace over the best, and microseconds a call."""

    ratio: float
    ours_us: float
    numpy_us: float


class Large(NamedTuple):
    """Selection of a few of thousands: worst ratio to the bound, how often proved best, time."""

    worst: float
    mean: float
    proved: float
    mean_ms: float
    worst_ms: float


def small(field: str, *, seed: int = FRESH, runs: int = 200, n: int = 24, k: int = 3) -> Small:
    """Compare with all sets in NumPy."""
    fields = [FIELDS[field](np.random.default_rng(seed + i), n, 2) for i in range(runs)]
    theirs = AllSets(n, k)
    ratios = [select(g, k).value / trace(g, theirs(g)) for g in fields]
    ours_s, numpy_s = interleaved(lambda g: select(g, k), theirs, fields)
    return Small(float(np.mean(ratios)), 1e6 * ours_s, 1e6 * numpy_s)


def large(field: str, *, seed: int = FRESH, runs: int = 60, d: int = 2) -> Large:
    """Compare with the dual bound; 6 of 2000."""
    found: list[Selection] = []
    times: list[float] = []
    for i in range(runs):
        g = FIELDS[field](np.random.default_rng(seed + i), 2000, d)
        times.append(min(_timed(g) for _ in range(3)))
        found.append(select(g, 6))
    ratios = np.array([one.ratio for one in found])
    proved = float(np.mean([one.optimal for one in found]))
    ms = 1e3 * np.array(times)
    return Large(
        float(ratios.max()), float(ratios.mean()), proved, float(ms.mean()), float(ms.max())
    )


def paper(*, seed: int = FRESH, runs: int = 400, n: int = 24) -> dict[str, float]:
    """Mean trace over that of all sets: the paper's rule, printed and corrected, and its greedy."""
    totals = {"as printed": 0.0, "corrected": 0.0, "best pair, best third": 0.0}
    for i in range(runs):
        rng = np.random.default_rng(seed + i)
        sensors, target = rng.uniform(-1, 1, (n, 2)), np.zeros(2)
        g = reading_gains(EQUAL, sensors, target)
        best = select(g, 3).value
        chosen = (
            function_2d(sensors, target, printed=True),
            function_2d(sensors, target),
            best_pair_and_next(sensors, target, 3),
        )
        for name, triple in zip(totals, chosen, strict=True):
            totals[name] += trace(g, triple) / best / runs
    return totals


def trace(g: Matrix, chosen: Indices) -> float:
    """Trace of what is left."""
    return float(np.trace(np.linalg.inv(g[chosen].T @ g[chosen])))


def interleaved(
    ours: Callable[[Matrix], object], theirs: Callable[[Matrix], object], fields: list[Matrix]
) -> tuple[float, float]:
    """Seconds of processor a call of each, the least over rounds in turn."""
    best = [np.inf, np.inf]
    for _ in range(7):
        for side, call in enumerate((ours, theirs)):
            start = time.process_time()
            for g in fields:
                call(g)
            best[side] = min(best[side], (time.process_time() - start) / len(fields))
    return best[0], best[1]


def _timed(g: Matrix) -> float:
    start = time.process_time()
    select(g, 6)
    return time.process_time() - start


def main() -> None:
    """Print the tables."""
    print("3 of 24 in the plane, against all 2024 sets")
    for name in FIELDS:
        found = small(name)
        print(
            f"  {name:22s} mean trace over the best {found.ratio:.6f}, {found.ours_us:5.1f} us "
            f"(NumPy, all sets: {found.numpy_us:5.1f} us)"
        )
    print("Function-2D, 3 of 24: mean trace over the best")
    for name, ratio in paper().items():
        print(f"  {name:22s} {ratio:.3f}")
    print("6 of 2000, against the dual bound of the relaxation, 60 fields")
    for d in (2, 3):
        for name in FIELDS:
            one = large(name, d=d)
            print(
                f"  {d}-D {name:22s} worst {one.worst:.4f}, mean {one.mean:.4f}, proved best "
                f"{100 * one.proved:3.0f} %, {one.mean_ms:.2f} ms (worst {one.worst_ms:.2f})"
            )
    print("growth with n, k = 6, ranges with growing noise [ms]")
    for n in (100, 1000, 10_000, 100_000):
        g = growing_ranges(np.random.default_rng(FRESH), n)
        print(f"  n = {n:6d}: {1e3 * min(_timed(g) for _ in range(3)):.2f}")


if __name__ == "__main__":
    main()
