"""Fields of range sensors, and tracks in them, for tests of the scheduler."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackfield.motion import ConstantVelocity
from trackfield.network.site import SchedulingSettings, Site, Target
from trackfield.raster import Region
from trackfield.scheduling.scheduler import Scheduler
from trackfield.scheduling.scheduler_state import Sighted
from trackfield.scheduling.serving import Able, Sensors, sensors_of
from trackfield.sensing.range import RangeModel
from trackfield.types import Matrix, Status, Tracks, Vector

SIDE_M = 20.0
MODEL = RangeModel(sigma_m=0.2, max_range_m=4.0)


def positions(count: int = 400, seed: int = 0) -> Matrix:
    """Nodes (n, 2) anywhere in the field."""
    return np.random.default_rng(seed).uniform(0.0, SIDE_M, (count, 2))


def field(places: Matrix | None = None, model: RangeModel = MODEL) -> Sensors:
    """Nodes that all have one model."""
    places = positions() if places is None else places
    reach = np.full(len(places), min(model.max_range_m, 1e6))
    return sensors_of(places, (model,) * len(places), reach)


def able(count: int, *, ready: bool = True) -> Able:
    """All live, and are awake or not; none senses yet."""
    no = np.zeros(count, np.bool_)
    return Able(~no, np.full(count, ready), no, np.ones(count))


def scheduler(places: Matrix | None = None, **settings: object) -> Scheduler:
    """A scheduler of a field without a watch."""
    chosen = SchedulingSettings(**{"sweep_s": 0.0, **settings})  # type: ignore[arg-type]
    region = Region(0.0, 0.0, SIDE_M, SIDE_M)
    return Scheduler(field(places), chosen, ConstantVelocity(0.01), region)


def sighted(
    t_s: float, states: Sequence[Sequence[float]], status: Status = Status.CONFIRMED
) -> Sighted:
    """Tracks 1, 2, ... in these states [x, y, vx, vy], well known."""
    m = len(states)
    return Sighted(
        np.arange(1, m + 1, dtype=np.int32),
        np.full(m, t_s),
        np.array(states, float).reshape(-1, 4),
        np.tile(np.diag([0.01, 0.01, 0.01, 0.01]), (m, 1, 1)),
        np.full(m, status, np.int32),
        np.zeros(m, np.bool_),
    )


def site(places: Matrix | None = None, **settings: object) -> Site:
    """The same as a site."""
    places = positions() if places is None else places
    return Site(
        "field",
        tuple(f"s{i}" for i in range(len(places))),
        np.column_stack([places, np.full(len(places), np.nan)]),
        (MODEL,) * len(places),
        target=Target(motion="cv", accel_sigma_m_s2=0.1, max_speed_m_s=2.0),
        scheduling=SchedulingSettings(**settings),  # type: ignore[arg-type]
    )


def tracks(t_s: Vector, track: Vector, states: Matrix, status: Vector | None = None) -> Tracks:
    """Rows of tracks, each known to .1 m."""
    m = len(t_s)
    nothing = np.full((m, 1), np.nan)
    return Tracks(
        t_s=np.asarray(t_s, float),
        track=np.asarray(track, np.int32),
        position=np.hstack([states[:, :2], nothing]),
        velocity=np.hstack([states[:, 2:], nothing]),
        covariance=np.tile([0.01, 0.0, 0.01], (m, 1)),
        status=np.full(m, Status.CONFIRMED, np.int32)
        if status is None
        else np.asarray(status, np.int32),
        target=np.full(m, -1, np.int32),
        nis=np.ones(m),
        target_ids=(),
    )
