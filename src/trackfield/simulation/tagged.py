"""Tagged targets: simulated ranges as the tables that a recording has, and a world of many targets.

All of it works on whole arrays: a thousand targets over a thousand steps are a few seconds.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from trackfield.network.site import Site, range_models
from trackfield.sensing import range as ranging
from trackfield.sensing.range import Nlos
from trackfield.simulation.roads import times
from trackfield.types import Indices, Matrix, Readings, Truth, Vector

TARGETS_AT_ONCE = 20  # so that a part of a large world stays in the cache


class World(NamedTuple):
    """How `wander` moves its targets, and how often their tags are ranged."""

    targets: int = 10
    steps: int = 100
    dt_s: float = 0.1
    speed_m_s: float = 1.0
    accel_sigma_m_s2: float = 0.2
    height_m: float = 0.0


def to_readings(
    t_s: Vector, ranges: Matrix, sensor_ids: tuple[str, ...], target_ids: tuple[str, ...] = ("0",)
) -> Readings:
    """Table of the ranges (K, n) of one target, or (targets, K, n) of several; NaN says nothing.

    Rows are in order of time, then target, then sensor.
    """
    cube = np.moveaxis(ranges if ranges.ndim == 3 else ranges[None], 0, 1)
    step, target, sensor = (i.astype(np.int32) for i in np.nonzero(~np.isnan(cube)))
    return _table(t_s[step], target, sensor, cube[step, target, sensor], (sensor_ids, target_ids))


def to_truth(t_s: Vector, states: Matrix, target_ids: tuple[str, ...] = ("0",)) -> Truth:
    """Table of the states (K, 4) of one target, or (targets, K, 4) of several, [x, y, vx, vy].

    Rows are in order of time, then target; the height is unknown (NaN).
    """
    cube = np.moveaxis(states if states.ndim == 3 else states[None], 0, 1)
    steps, targets = cube.shape[:2]
    position = np.full((steps * targets, 3), np.nan)
    position[:, :2] = cube[..., :2].reshape(-1, 2)
    return Truth(
        t_s=np.repeat(t_s, targets),
        target=np.tile(np.arange(targets, dtype=np.int32), steps),
        position=position,
        target_ids=target_ids,
    )


def wander(
    rng: np.random.Generator, site: Site, world: World, *, nlos: Nlos | None = None
) -> tuple[Readings, Truth]:
    """Targets on random constant-velocity paths inside the sensors' bounding box, and their ranges.

    Every step, every sensor in range of a target reads its distance under the sensor's own model
    (bias, scale, both noises and the error that stays alike over `correlation_length_m`).
    """
    states = paths(rng, site, world)
    anchors = np.where(np.isnan(site.positions), world.height_m, site.positions)
    models = ranging.columns(range_models(site))
    parts: list[tuple[Indices, Indices, Indices, Vector]] = []
    for first in range(0, world.targets, TARGETS_AT_ONCE):
        some = states[first : first + TARGETS_AT_ONCE]
        path = np.full((*some.shape[:2], anchors.shape[1]), world.height_m)
        path[..., :2] = some[..., :2]
        drawn = ranging.simulate(models, anchors, path=path, rng=rng, nlos=nlos)
        target, step, sensor = (i.astype(np.int32) for i in np.nonzero(drawn.heard))
        parts.append((step, target + np.int32(first), sensor, drawn.value[drawn.heard]))
    step, target, sensor, value = (np.concatenate(part) for part in zip(*parts, strict=True))
    order = np.argsort(step, kind="stable")  # within a step by target, then sensor, as before
    t_s = times(world.steps, world.dt_s)
    names = tuple(f"tag{i}" for i in range(world.targets))
    readings = _table(
        t_s[step[order]], target[order], sensor[order], value[order], (site.sensor_ids, names)
    )
    return readings, to_truth(t_s, states, names)


def paths(rng: np.random.Generator, site: Site, world: World) -> Matrix:
    """Draw states (targets, steps, 4): noisy constant velocity, thrown back by the walls."""
    low = np.nanmin(site.positions[:, :2], axis=0)
    high = np.nanmax(site.positions[:, :2], axis=0)
    position = rng.uniform(low, high, (world.targets, 2))
    heading = rng.uniform(-math.pi, math.pi, world.targets)
    velocity = world.speed_m_s * np.column_stack([np.cos(heading), np.sin(heading)])
    states = np.empty((world.targets, world.steps, 4))
    for k in range(world.steps):
        accel = world.accel_sigma_m_s2 * rng.standard_normal((world.targets, 2))
        position = position + world.dt_s * velocity + 0.5 * world.dt_s**2 * accel
        velocity = velocity + world.dt_s * accel
        for wall, sign in ((low, 1.0), (high, -1.0)):
            out = sign * (position - wall) < 0.0
            position = np.where(out, 2.0 * wall - position, position)
            velocity = np.where(out, sign * np.abs(velocity), velocity)
        position = np.clip(position, low, high)
        states[:, k] = np.hstack([position, velocity])
    return states


def _table(
    t_s: Vector,
    target: Indices,
    sensor: Indices,
    value: Vector,
    names: tuple[tuple[str, ...], tuple[str, ...]],
) -> Readings:
    sensor_ids, target_ids = names
    size = value.size
    nothing = np.full(size, np.nan)
    return Readings(
        t_s=t_s,
        sensor=sensor,
        value=value,
        target=target,
        kind=np.zeros(size, dtype=np.int32),
        sigma=nothing,
        arrival_s=nothing,
        sensor_ids=sensor_ids,
        target_ids=target_ids,
        kinds=("range",),
    )
