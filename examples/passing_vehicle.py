"""A vehicle of unknown loudness drives past microphones that send one word each: its trajectory."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from trackfield.pipeline.trajectories import TrajectoryTracker
from trackfield.simulation.hearing import all_of, hear_readings
from trackfield.simulation.scenario_file import load_scenario
from trackfield.simulation.told_site import site_of
from trackfield.simulation.world import make_world
from trackfield.types import select_rows

SCENARIO = Path(__file__).parent / "scenarios" / "messages.toml"


def main() -> None:
    """Take the messages one by one, and tell after each what passed."""
    world = make_world(load_scenario(SCENARIO))
    messages, _ = all_of(hear_readings(world))
    tracker = TrajectoryTracker(site_of(world))
    for row in range(len(messages)):
        tracker.process(select_rows(messages, slice(row, row + 1)))
        name = messages.sensor_ids[int(messages.sensor[row])]
        found = tracker.trajectories
        if not found:
            print(f"{row + 1} messages, the last of {name}: not enough yet")
            continue
        best, several = found[0], f", one of {len(found)}" if len(found) > 1 else ""
        speed, sigma = np.hypot(*best.velocity), np.sqrt(np.diag(best.covariance))
        print(
            f"{row + 1} messages, the last of {name}: {speed:.2f} m/s, power {best.power:.2f} "
            f"+- {sigma[0]:.2f} ({best.weight:.0%}{several})"
        )
    tracker.finish()
    truth = world.truth.position[:, :2]
    speed = np.linalg.norm(truth[-1] - truth[0]) / (world.truth.t_s[-1] - world.truth.t_s[0])
    print(f"truth: {speed:.2f} m/s, power 1")


if __name__ == "__main__":
    main()
