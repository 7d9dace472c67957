"""Small sites and runs of ranges for tests of the tracker: readings as rows, tables and scans."""

import math
from itertools import groupby
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from trackfield.network.site import Site, Target, TrackerSettings
from trackfield.sensing.range import RangeModel
from trackfield.types import Readings


class Heard(NamedTuple):
    """One reading; `sensor` counts from 0, a sigma of 0 is none."""

    t: float
    sensor: int
    value: float
    sigma: float = 0.0
    target: str | None = None


def box(
    *models: RangeModel,
    size=10.0,
    heights=None,
    window_s=1.0,
    drop_s=300.0,
    self_calibration=True,
    **target,
) -> Site:
    """Eight sensors around a square of 2 `size`; models in turn, the targets on the floor."""
    turn = np.arange(8) * math.pi / 4 + 0.1
    reach = np.where(np.arange(8) % 2, 1.3, 1.0) * size
    z = np.full(8, np.nan) if heights is None else np.resize(heights, 8)
    given = models or (RangeModel(sigma_m=0.1),)
    return Site(
        name="box",
        sensor_ids=tuple("abcdefgh"),
        positions=np.column_stack([reach * np.cos(turn), reach * np.sin(turn), z]),
        models=tuple(given[i % len(given)] for i in range(8)),
        target=Target(**target),
        tracker=TrackerSettings(
            window_s=window_s, drop_s=drop_s, self_calibration=self_calibration
        ),
    )


def table(site: Site, rows) -> Readings:
    """Readings as a table, in the order in which they came."""
    rows = list(rows)
    names = tuple(sorted({z.target for z in rows if z.target is not None}))
    sigma = np.array([z.sigma for z in rows], float)
    return Readings(
        t_s=np.array([z.t for z in rows], float),
        sensor=np.array([z.sensor for z in rows], np.int32),
        value=np.array([z.value for z in rows], float),
        target=np.array(
            [-1 if z.target is None else names.index(z.target) for z in rows], np.int32
        ),
        kind=np.zeros(len(rows), np.int32),
        sigma=np.where(sigma > 0.0, sigma, np.nan),
        arrival_s=np.full(len(rows), np.nan),
        sensor_ids=site.sensor_ids,
        target_ids=names,
        kinds=("range",),
    )


def scans(rows):
    """Readings by time: (t, readings) in order."""
    return [(t, list(group)) for t, group in groupby(rows, attrgetter("t"))]


def path(t, *, dimensions=2, height=0.0, phase=0.0):
    """A winding path (n, 3) inside the box."""
    t = np.asarray(t, float)
    z = 1.5 + np.sin(0.23 * t + phase) if dimensions == 3 else np.full(t.shape, height)
    x, y = 5.0 * np.sin(0.16 * t + phase), 4.0 * np.sin(0.09 * t + 1.0 + phase)
    return np.stack([x, y, z], axis=-1)


def run(
    rng: np.random.Generator,
    site: Site,
    times,
    *,
    most=4,
    late=0.0,
    given=0.0,
    noise=0.1,
    height=0.0,
    target=None,
    phase=0.0,
) -> list[Heard]:
    """Readings of a target on `path`: at first of all sensors, then of 1 to `most` at a time.

    Share `late` of them is too long by Exp(1 m), share `given` tells its own sigma.
    """
    truth = path(times, dimensions=site.target.dimensions, height=height, phase=phase)
    at = np.where(np.isnan(site.positions), 0.0, site.positions)
    rows = []
    for k, t in enumerate(times):
        count = 8 if k == 0 else int(rng.integers(1, most + 1))
        for i in sorted(rng.permutation(8)[:count]):
            m, r = site.models[i], float(np.linalg.norm(truth[k] - at[i]))
            z = m.bias_m + (1.0 + m.scale) * r + noise * rng.standard_normal()
            z += float(rng.random() < late and k > 0) * rng.exponential()
            sigma = float(rng.uniform(0.1, 0.3)) if rng.random() < given else 0.0
            rows.append(Heard(float(t), int(i), float(z), sigma, target))
    return rows


def uneven(rng: np.random.Generator, steps: int, *, start=100.0):
    """Times with steps of hundredths of a second up to outages of 8 s."""
    steps_s = rng.choice(
        [0.05, 0.1, 0.7, 1.3, 4.0, 8.0], steps - 1, p=[0.3, 0.4, 0.15, 0.05, 0.05, 0.05]
    )
    return start + np.concatenate([[0.0], np.cumsum(steps_s)])
