"""Reports of a few walkers, as tables, and an operator with the plain tracker in it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from plain_associator import PlainAssociator
from trackfield.network.site import ReportSettings, Site, TrackerSettings
from trackfield.pipeline.untagged import Feed, UntaggedTracker
from trackfield.raster import Region
from trackfield.types import Reports, join_rows, select_rows

REGION = Region(0.0, 0.0, 60.0, 40.0)


def site(**changes) -> Site:
    fields = {
        "name": "field",
        "sensor_ids": (),
        "positions": np.empty((0, 3)),
        "models": (),
        "reports": ReportSettings(region=REGION, step_s=0.5, sigma_m=0.3),
        "tracker": TrackerSettings(window_steps=6),
    }
    return Site(**{**fields, **changes})


def table(rows) -> Reports:
    """Reports of rows t, x, y[, arrival]."""
    rows = [tuple(row) for row in rows]
    data = np.array([row[:3] for row in rows], float).reshape(-1, 3)
    n = len(data)
    arrival = np.array([row[3] if len(row) > 3 else np.nan for row in rows], float)
    position = np.column_stack([data[:, 1:], np.full(n, np.nan)])
    nothing = np.full((n, 3), np.nan)
    return Reports(data[:, 0].copy(), arrival, position, nothing, np.full(n, np.nan))


def walkers(seed=0, steps=40, targets=3, clutter=1.0, start_s=3.0) -> Reports:
    """Walkers on straight lines, seen in 80 % of the steps of half a second, amid clutter."""
    rng = np.random.default_rng(seed)
    place = rng.uniform((5, 5), (55, 35), (targets, 2))
    speed = rng.normal(0.0, 0.7, (targets, 2))
    rows = []
    for k in range(steps):
        t = start_s + 0.5 * k
        seen = (place + 0.5 * k * speed + rng.normal(0.0, 0.3, place.shape))[
            rng.random(targets) < 0.8
        ]
        false = rng.uniform(REGION[:2], REGION[2:], (rng.poisson(clutter), 2))
        rows += [(t, x, y) for x, y in (*seen, *false)]
    inside = [row for row in rows if REGION.contains(np.array(row[1:]))]
    return table(inside)


def operator(place=None, *, window=6, associator=None, **options) -> UntaggedTracker:
    place = site() if place is None else place
    return UntaggedTracker(place, Feed(associator=associator or PlainAssociator(window)), **options)


def run(tracker, *tables):
    parts = [tracker.process(one) for one in tables]
    return join_rows([*parts, tracker.finish()])


def pieces(reports: Reports, cuts) -> list[Reports]:
    edges = [0, *sorted(cuts), len(reports)]
    rows = np.arange(len(reports))
    return [select_rows(reports, rows[i:j]) for i, j in pairwise(edges)]


def joined(*tables: Reports) -> Reports:
    return join_rows(tables)


def assert_same_rows(left, right):
    for name, column in left.to_numpy().items():
        np.testing.assert_array_equal(column, right.to_numpy()[name], err_msg=name)
