"""Cameras, turn rates and motion sensors in a room: one track of what none of them sees alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from trackfield.pipeline.dispatch import family_of, tracker_of
from trackfield.simulation.hearing import all_of, hear_readings
from trackfield.simulation.scenario_file import load_scenario
from trackfield.simulation.told_site import site_of
from trackfield.simulation.world import make_world
from trackfield.types import Status, select_rows

SCENARIO = Path(__file__).parent / "scenarios" / "motion.toml"


def main() -> None:
    """Follow a walker for twenty seconds; readings come in tables of two seconds."""
    world = make_world(load_scenario(SCENARIO))
    readings, _ = all_of(hear_readings(world))
    tracker = tracker_of(site_of(world), family_of(readings))
    for start in np.arange(0.0, 20.0, 2.0):
        now = (readings.t_s >= start) & (readings.t_s < start + 2.0)
        rows = tracker.process(select_rows(readings, now), watermark_s=float(start) + 1.99)
        if len(rows) and rows.status[-1] != Status.TENTATIVE:
            x, y, _ = rows.position[-1]
            true = world.truth.position[np.searchsorted(world.truth.t_s, rows.t_s[-1])]
            sigma = np.sqrt(rows.covariance[-1, [0, 2]].sum())
            told = f"({x:.2f}, {y:.2f}) m, +- {sigma:.2f} m; truth ({true[0]:.2f}, {true[1]:.2f}) m"
            print(f"{rows.t_s[-1]:5.2f} s: {told}")
    tracker.finish()
    counts = tracker.counts
    print(f"{counts['accepted']} readings of {', '.join(world.scenario.models)}")


if __name__ == "__main__":
    main()
