"""Reading by reading: rows come out as soon as they are settled, and a restart loses nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackfield import Readings, Site, Tracker
from trackfield.sensing.range import UNCALIBRATED, Nlos
from trackfield.simulation.tagged import World, wander

CORNERS = [[0.0, 0.0, np.nan], [12.0, 0.0, np.nan], [12.0, 8.0, np.nan], [0.0, 8.0, np.nan]]


def arriving(readings: Readings) -> list[Readings]:
    """Cut a run into tables of one reading each, as a radio would deliver them."""
    columns = ("t_s", "sensor", "value", "target", "kind", "sigma", "arrival_s")
    return [
        replace(readings, **{name: getattr(readings, name)[row : row + 1] for name in columns})
        for row in range(len(readings))
    ]


def main() -> None:
    """Track two simulated tags whose direct path is blocked now and then."""
    site = Site("hall", ("a1", "a2", "a3", "a4"), np.array(CORNERS), (UNCALIBRATED,) * 4)
    world = World(targets=2, steps=100)
    readings, truth = wander(np.random.default_rng(1), site, world, nlos=Nlos(0.1, 1.0))

    tracker, rows, last = Tracker(site), 0, ""
    for row, reading in enumerate(arriving(readings)):
        if row == len(readings) // 2:  # as if the program had been started again
            state = tracker.snapshot()
            tracker = Tracker(site)
            tracker.restore(state)
        shown = tracker.process(reading)
        rows += len(shown)
        if len(shown):
            x, y, _ = shown.position[-1]
            last = f"{shown.target_ids[shown.target[-1]]} at ({x:.1f}, {y:.1f}) m"
    rows += len(tracker.finish())
    print(f"{len(readings)} readings, {rows} rows; the last before the end: {last}")
    print("truth:", *(f"({x:.1f}, {y:.1f})" for x, y, _ in truth.position[-2:]))


if __name__ == "__main__":
    main()
