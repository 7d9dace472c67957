"""Tracks decide who is awake, and who is awake decides the tracks: a loop of your own making."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackfield.network.node_index import NodeIndex
from trackfield.network.site import SchedulingSettings, Site, Target
from trackfield.pipeline.tagged import Tracker
from trackfield.sensing.range import RangeModel
from trackfield.simulation.closed_loop import closed_loop, outcome
from trackfield.simulation.on_demand import RangesOnDemand
from trackfield.types import Matrix

SIDE_M, STEPS = 20.0, 60
MODEL = RangeModel(sigma_m=0.2, max_range_m=5.0)


def field(rng: np.random.Generator) -> Site:
    """Four hundred radios anywhere in a square."""
    places = rng.uniform(0.0, SIDE_M, (400, 2))
    return Site(
        "field",
        tuple(f"s{i}" for i in range(len(places))),
        np.column_stack([places, np.full(len(places), np.nan)]),
        (MODEL,) * len(places),
        target=Target(motion="cv", accel_sigma_m_s2=0.1),
        scheduling=SchedulingSettings(sweep_s=3.0, watch="never"),
    )


def run(site: Site, path: Matrix) -> str:
    """Track one target in closed loop, and say how it went."""
    nodes = NodeIndex(site.positions[:, :2])
    senses = RangesOnDemand(nodes, MODEL, path[None], 1.0, np.random.default_rng(2))
    turns = list(closed_loop(site, senses, Tracker(site), duration_s=float(STEPS)))
    found = outcome(turns[10:], site)
    errors = [
        np.hypot(*(turn.tracks.position[-1, :2] - path[round(turn.told.t_s)]))
        for turn in turns[10:]
        if len(turn.tracks)
    ]
    asleep, awake, sensing, master = found.in_mode_s / found.duration_s
    return (
        f"{sensing + master:.1f} nodes sense, {awake:.1f} are awake, {asleep:.0f} sleep; "
        f"error {np.mean(errors):.2f} m, {found.per_tracked_s:.0f} W above sleep"
    )


def main() -> None:
    """Compare four sensors with all that hear the target."""
    site = field(np.random.default_rng(1))
    seconds = np.arange(STEPS)
    path = np.column_stack([3.0 + 0.22 * seconds, 10.0 + 4.0 * np.sin(seconds / 15.0)])
    for policy in ("all", "accuracy", "soft"):
        settings = replace(site.scheduling, policy=policy)
        print(f"{policy:>8s}: {run(replace(site, scheduling=settings), path)}")


if __name__ == "__main__":
    main()
