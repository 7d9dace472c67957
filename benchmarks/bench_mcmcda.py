"""The sampler of partitions: moves per second, how fast a cold start gets good, crowds and silence.

Times are of the processor, the least of some repeats, so that a busy machine matters little.
Windows have 15 targets and 6 false reports a step (10 steps), or are cut from the runs of
`report_scenario` (15 steps). The best score known of a window is the best of long runs, one of them
from the truth.
"""

from __future__ import annotations

import time

import numpy as np
from report_scenario import FALSE_PER_SCAN, P_DETECTION, SCENE, SIGMA_M, draw

from trackfield.association import sampling
from trackfield.association.contract import ReportScan
from trackfield.association.mcmcda import Mcmcda
from trackfield.association.partition import Window
from trackfield.association.sampling import Sampling
from trackfield.association.window import Known, window
from trackfield.types import Indices

KNOWN = Known(SIGMA_M, P_DETECTION, FALSE_PER_SCAN)
ALIKE = (1.0,) * len(sampling.MOVES)
SLOTS, TARGETS = 10, 15
COLD_MOVES, LONG_MOVES = 3000, 100_000


def crowded_window(seed: int) -> tuple[Window, Indices]:
    """Draw a window of 15 targets over 10 steps; and the target of each report, -1 of none."""
    rng = np.random.default_rng(seed)
    angle, speed = rng.uniform(0, 2 * np.pi, TARGETS), rng.uniform(0.5, 1.5, TARGETS)
    place = rng.uniform(20, 80, (TARGETS, 2))
    velocity = speed[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    scans: list[ReportScan] = []
    sources: list[Indices] = []
    for t in range(SLOTS):
        seen = np.flatnonzero(rng.random(TARGETS) < P_DETECTION)
        false = rng.uniform(0, 100, (rng.poisson(FALSE_PER_SCAN), 2))
        reports = place[seen] + SIGMA_M * rng.standard_normal((seen.size, 2))
        scans.append(_scan(t, np.vstack([reports, false])))
        sources.append(np.concatenate([seen, np.full(len(false), -1)]).astype(np.int32))
        push = 0.15 * rng.standard_normal((TARGETS, 2))
        place, velocity = place + velocity + push / 2, velocity + push
    made = window(SCENE, scans, known=KNOWN, begins=False, paper=False)
    return made, np.concatenate(sources)


def cut_window(seed: int, begin: int) -> tuple[Window, Indices]:
    """Cut 15 steps out of a run; and the target of each report, -1 of none."""
    run = draw(seed)
    ends = np.cumsum([len(scan.number) for scan in run.scans])
    made = window(SCENE, run.scans[begin : begin + 15], known=KNOWN, begins=False, paper=False)
    return made, run.source[ends[begin - 1] : ends[begin + 14]]


def moves_per_second(settings: Sampling) -> float:
    """Time a chain that has settled: moves per second [1/s], the best of five runs."""
    given, source = crowded_window(0)
    chain = sampling.start(given, settings, owner=source, random=[1, 2, 3, 4])
    chain.advance(100_000)
    taken: list[float] = []
    for _ in range(5):
        before = time.process_time()
        chain.advance(200_000)
        taken.append(time.process_time() - before)
    return 200_000 / min(taken)


def cold_gaps(
    given: Window, source: Indices, settings: Sampling, *, starts: int = 4
) -> list[float]:
    """How far chains that begin without tracks are from the best score known after 3000 moves."""
    nothing = np.full(len(given), -1, np.int32)
    known = []
    for number, owner in enumerate((source, nothing, nothing)):
        chain = sampling.start(given, Sampling(), owner=owner, random=[1, 2, 3, number + 1])
        chain.advance(LONG_MOVES)
        known.append(chain.scores()[1])
    cold = []
    for number in range(starts):
        chain = sampling.start(given, settings, owner=nothing, random=[9, 8, 7, number + 1])
        chain.advance(COLD_MOVES)
        cold.append(chain.scores()[1])
    return [max(*known, *cold) - score for score in cold]


def step_times(scans: list[ReportScan], settings: Sampling) -> tuple[float, float]:
    """Mean and longest processor time of a step [ms]."""
    tracker = Mcmcda(SCENE, settings)
    state, taken = tracker.initial(), []
    for scan in scans:
        before = time.process_time()
        state, _ = tracker.step(state, scan)
        taken.append((time.process_time() - before) * 1e3)
    return float(np.mean(taken)), max(taken)


def main() -> None:
    """Print all of it."""
    for name, settings in (
        ("uniform", Sampling(window=SLOTS, informed=False, weights=ALIKE)),
        ("informed", Sampling(window=SLOTS)),
    ):
        print(f"{name:9s} {moves_per_second(settings) / 1e6:6.2f} million moves per second")
    places = [(seed, begin) for seed in range(100, 106) for begin in (10, 35, 60)]
    uniform = Sampling(informed=False, weights=ALIKE)
    for name, gaps in (
        ("15 targets", [cold_gaps(*crowded_window(seed), Sampling()) for seed in range(6)]),
        ("run", [cold_gaps(*cut_window(*place), Sampling()) for place in places]),
        ("run, uniform", [cold_gaps(*cut_window(*place), uniform) for place in places]),
    ):
        worst = max(float(np.mean(row)) for row in gaps)
        print(
            f"{name:12s} {np.mean(gaps):6.2f} nats from the best known after {COLD_MOVES} moves "
            f"from nothing; worst window {worst:.2f}"
        )
    rng = np.random.default_rng(0)
    quiet = [_scan(t, np.zeros((0, 2))) for t in range(100)]
    storm = [_scan(t, rng.uniform(0, 100, (600, 2))) for t in range(30)]
    for name, scans in (
        ("run", list(draw(100).scans)),
        ("silence", quiet),
        ("100 x clutter", storm),
    ):
        mean, most = step_times(scans, Sampling())
        print(f"{name:13s} {mean:7.2f} ms a step, the longest {most:7.2f} ms")


def _scan(t: int, position: np.ndarray) -> ReportScan:
    n = len(position)
    numbers = np.arange(t * 1000, t * 1000 + n, dtype=np.int32)
    return ReportScan(float(t), position, np.full((n, 3), np.nan), numbers)


if __name__ == "__main__":
    main()
