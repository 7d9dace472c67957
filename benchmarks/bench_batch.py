"""A thousand targets, a thousand steps, eight ranges each, in one batch on one core.

Prints processor seconds and memory for the default tracker (IMM) and for constant velocity, and
for half as many steps: time and memory are to grow linearly.
"""

from __future__ import annotations

import resource
import sys
import time

import numpy as np

from trackfield.network.site import Site, Target
from trackfield.pipeline.tagged import track
from trackfield.sensing.range import RangeModel
from trackfield.types import Readings

CORNERS = [[0, 0], [100, 0], [0, 100], [100, 100], [50, 0], [0, 50], [100, 50], [50, 100]]
SIGMA_M, DT_S = 0.1, 0.1


def batch(targets: int, steps: int, seed: int = 0) -> tuple[Readings, np.ndarray]:
    """Make readings of targets on straight ways, and where they end (targets, 2)."""
    rng = np.random.default_rng(seed)
    sensors = np.array(CORNERS, float)
    start, velocity = rng.uniform(20, 80, (targets, 2)), 0.3 * rng.standard_normal((targets, 2))
    t = np.arange(steps) * DT_S
    path = start + velocity * t[:, None, None]
    r = np.linalg.norm(path[:, :, None] - sensors, axis=3)
    rows = r.size
    n = len(sensors)
    readings = Readings(
        t_s=np.repeat(t, targets * n),
        sensor=np.tile(np.arange(n, dtype=np.int32), targets * steps),
        value=(r + SIGMA_M * rng.standard_normal(r.shape)).ravel(),
        target=np.tile(np.repeat(np.arange(targets, dtype=np.int32), n), steps),
        kind=np.zeros(rows, np.int32),
        sigma=np.full(rows, np.nan),
        arrival_s=np.full(rows, np.nan),
        sensor_ids=tuple(str(i) for i in range(n)),
        target_ids=tuple(f"t{i}" for i in range(targets)),
        kinds=("range",),
    )
    return readings, path[-1]


def site(motion: str) -> Site:
    """Eight sensors around a square of 100 m, noise known."""
    n = len(CORNERS)
    places = np.column_stack([np.array(CORNERS, float), np.full(n, np.nan)])
    models = (RangeModel(sigma_m=SIGMA_M),) * n
    target = Target(motion="imm") if motion == "imm" else Target(motion="cv")
    return Site("batch", tuple(str(i) for i in range(n)), places, models, target)


def main() -> None:
    """Print the table."""
    targets = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    for motion, steps in (("imm", 500), ("imm", 1000), ("cv", 1000)):
        readings, end = batch(targets, steps)
        held = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        before, wall = time.process_time(), time.perf_counter()
        tracks = track(site(motion), readings).tracks
        used, wall = time.process_time() - before, time.perf_counter() - wall
        grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - held) / 1024
        last = tracks.position[-targets:, :2] - end[tracks.target[-targets:]]
        rmse = float(np.sqrt((last**2).sum(1).mean()))
        print(
            f"{motion:4s} {targets} targets x {steps} steps x 8 ranges: "
            f"{used:5.2f} s of processor, "
            f"{wall:5.2f} s of wall, {used / targets / steps * 1e6:5.2f} us a scan, "
            f"peak memory {grown:+.0f} MiB, RMSE at the end {rmse:.3f} m"
        )


if __name__ == "__main__":
    main()
