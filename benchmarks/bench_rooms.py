"""Positions and rooms at home: errors, and how often the room flips while nobody moves.

    python benchmarks/bench_rooms.py [RUNS [FIRST_SEED [grid|tracker]]]

Runs of ten minutes in `room_world`, the receivers once and four times a second, bodies in the way
for 2 s at a time or for one reading only. Beside the tracker stands a filter on a grid that knows
how the world is made (places of 0.2 m, at rest or on the way): what the readings allow.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from room_world import DEPTH_M, MODEL, ROOMS, WIDTH_M, RoomRun, room_run
from scipy.ndimage import gaussian_filter

from trackfield.filtering import rssi_tracker
from trackfield.filtering.rooms import RoomRules, follow_rooms
from trackfield.pipeline.scanned import ScanTracker
from trackfield.sensing import rssi
from trackfield.types import Status, Tracks, join_rows

_CELL_M, _TICK_S, _BLUR_M = 0.2, 0.25, 0.6
_LEAVES_PER_S, _STOPS_PER_S = 1.0 / 40.0, 1.0 / 4.0
_WARM_S = 10.0


class Found(NamedTuple):
    """Errors (n,) [m] of rows after ten seconds; flips, minutes, delays [s] over all rests.

    A flip is a change of the shown room during a rest, but for the first one into the true room.
    `right` and `rows` count rows during rests.
    """

    error_m: NDArray[np.float64]
    flips: int
    rest_min: float
    delays_s: list[float]
    right: int
    rows: int


def tracked(run: RoomRun) -> Tracks:
    """Track a run by the default tracker."""
    tracker = ScanTracker(run.site, rssi_tracker.create(run.site))
    return join_rows([tracker.process(run.readings), tracker.finish()])


def gridded(run: RoomRun) -> Tracks:
    """Track a run by a filter on a grid that knows the world."""
    model = run.site.models[0]
    x, y = np.arange(_CELL_M / 2, WIDTH_M, _CELL_M), np.arange(_CELL_M / 2, DEPTH_M, _CELL_M)
    places = np.stack(np.meshgrid(x, y), axis=-1)
    mean = rssi.expected(model, rssi.distance(run.site.positions[:, :2], places))
    rest = np.full(places.shape[:2], 0.5 / places[..., 0].size)
    way, now = rest.copy(), 0.0
    leaves, stops = -np.expm1(-_TICK_S * np.array([_LEAVES_PER_S, _STOPS_PER_S]))
    rows = np.empty((len(run.readings), 5))
    readings = zip(run.readings.t_s, run.readings.sensor, run.readings.value, strict=True)
    for row, (t, sensor, value) in enumerate(readings):
        while t - now >= _TICK_S:
            now += _TICK_S
            going = gaussian_filter((1.0 - stops) * way + leaves * rest, _BLUR_M / _CELL_M)
            rest, way = (1.0 - leaves) * rest + stops * way, going
        variance = np.full(places.shape[:2], model.sigma_db**2)
        density = np.exp(rssi.log_density(model, value - mean[..., sensor], variance=variance))
        rest, way = rest * (density + 1e-9), way * (density + 1e-9)
        total = rest.sum() + way.sum()
        rest, way = rest / total, way / total
        p = rest + way
        middle = np.tensordot(p, places, axes=2)
        off = places - middle
        C = np.einsum("ij,ijk,ijl->kl", p, off, off)
        rows[row] = *middle, C[0, 0], C[0, 1], C[1, 1]
    n = len(rows)
    return Tracks(
        t_s=run.readings.t_s,
        track=np.zeros(n, np.int32),
        position=np.column_stack([rows[:, :2], np.full(n, np.nan)]),
        velocity=np.zeros((n, 3)),
        covariance=rows[:, 2:],
        status=np.full(n, int(Status.CONFIRMED), np.int32),
        target=np.zeros(n, np.int32),
        nis=np.full(n, np.nan),
        target_ids=("somebody",),
    )


def judged(run: RoomRun, tracks: Tracks, rules: RoomRules = RoomRules()) -> Found:  # noqa: B008
    """Compare tracks and their rooms with the truth."""
    rows, _ = follow_rooms(ROOMS, tracks, rules=rules)
    true = [np.interp(tracks.t_s, run.truth.t_s, run.truth.position[:, a]) for a in (0, 1)]
    error = np.linalg.norm(tracks.position[:, :2] - np.column_stack(true), axis=1)
    flips, right, count, minutes, delays = 0, 0, 0, 0.0, list[float]()
    for (begin, end), room in zip(run.rest, run.rest_room, strict=True):
        during = (rows.t_s >= begin) & (rows.t_s <= end)
        shown, t = rows.room[during], rows.t_s[during]
        if t.size < 2:
            continue
        hits = np.flatnonzero(shown == room)
        arrives = shown[0] != room and hits.size > 0
        flips += int(np.sum(np.diff(shown) != 0)) - int(arrives)
        minutes += (t[-1] - begin) / 60.0
        delays.append(float((t[hits[0]] if hits.size else t[-1]) - begin))
        right += hits.size
        count += t.size
    return Found(error[tracks.t_s > _WARM_S], flips, minutes, delays, right, count)


def summary(found: list[Found]) -> str:
    """One line: errors, flips, delays, share of rows in the true room."""
    error = np.concatenate([one.error_m for one in found])
    delays = np.concatenate([one.delays_s for one in found])
    flips = sum(one.flips for one in found) / sum(one.rest_min for one in found)
    right = sum(one.right for one in found) / sum(one.rows for one in found)
    median, p95 = np.quantile(error, [0.5, 0.95])
    return (
        f"median {median:.2f} m, p95 {p95:.2f} m; {flips:.3f} flips/min at rest, room right "
        f"{100 * right:.1f} % of the rest, after {delays.mean():.1f} s (p90 "
        f"{np.quantile(delays, 0.9):.1f} s)"
    )


def main() -> None:
    """Print a line for each rate, burst and way to track."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 100
    ways = {"grid": gridded, "tracker": tracked}
    if len(sys.argv) > 3:
        ways = {sys.argv[3]: ways[sys.argv[3]]}
    for burst_s in (0.0, 2.0):
        for rate_hz in (1.0, 4.0):
            model = replace(MODEL, burst_s=burst_s)
            world = [
                room_run(seed, rate_hz=rate_hz, model=model) for seed in range(first, first + runs)
            ]
            for name, way in ways.items():
                line = summary([judged(run, way(run)) for run in world])
                print(f"{rate_hz:g} Hz, bursts of {burst_s:g} s, {name}: {line}", flush=True)


if __name__ == "__main__":
    main()
