"""What sensors say of tagged targets: drawn target by target, as errors go on along a path."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.network.kinds import KINDS, SensorModel, kind_of
from trackfield.sensing import angular_rate, bearing, motion_rate, rssi_world
from trackfield.sensing import range as ranging
from trackfield.sensing.angular_rate import AngularRateModel
from trackfield.sensing.bearing import BearingModel
from trackfield.sensing.motion_rate import MotionRateModel
from trackfield.sensing.range import RangeModel
from trackfield.sensing.rssi import RssiModel
from trackfield.sensing.rssi_world import Shadows
from trackfield.simulation.deployment import Deployment, models_in_turn
from trackfield.simulation.scenario import Scenario
from trackfield.simulation.sensed import Steps
from trackfield.types import Indices, Matrix, Readings, Truth, Vector

_KINDS = tuple(KINDS)


class Drawn(NamedTuple):
    """All that is said of tagged targets in a run, (n,), by time, then target, then sensor."""

    t_s: Vector
    target: Indices
    sensor: Indices
    value: Vector
    kind: Indices  # in `KINDS`
    target_ids: tuple[str, ...]


class _Path(NamedTuple):
    """A target's times (m,), places (m, 2) and velocities (m, 2)."""

    t_s: Vector
    position: Matrix
    velocity: Matrix


class _Crew(NamedTuple):
    """The sensors (k,) of one kind, and the shadows that lie over the field of receivers."""

    model: SensorModel
    sensors: NDArray[np.intp]
    shadows: Shadows | None


class _Seen(NamedTuple):
    """Readings (m, k) of some sensors along a path, and which of them there are."""

    value: Matrix
    heard: NDArray[np.bool_]


def draw_tagged(
    scenario: Scenario, deployment: Deployment, truth: Truth, *, rng: np.random.Generator
) -> Drawn:
    """Draw what every sensor that hears a target reads of it, all along its path.

    Velocities are those of the middle between a step's neighbours. A run is drawn at once: it takes
    memory as the run has readings.
    """
    models = np.array(
        [_KINDS.index(kind_of(model)) for model in models_in_turn(scenario)], np.int32
    )
    crews = [
        _crew(model, np.flatnonzero(models == _KINDS.index(kind)), rng)
        for kind, model in scenario.tagged.items()
    ]
    order = np.argsort(truth.target, kind="stable")
    ends = np.cumsum(np.bincount(truth.target, minlength=len(truth.target_ids)))
    found: list[tuple[NDArray[np.generic], ...]] = []
    for target, rows in enumerate(np.split(order, ends[:-1]) if len(order) else []):
        path = _path(scenario, truth.t_s[rows], truth.position[rows, :2])
        for crew in crews:
            seen = _seen(crew, deployment.network.positions[crew.sensors], path, rng=rng)
            step, place = np.nonzero(seen.heard & deployment.network.alive[crew.sensors])
            said = np.full(step.size, target, np.int32), crew.sensors[place].astype(np.int32)
            found.append((path.t_s[step], *said, seen.value[step, place]))
    nothing = (np.empty(0), np.empty(0, np.int32), np.empty(0, np.int32), np.empty(0))
    t_s, target, sensor, value = (
        np.concatenate(part) for part in zip(*found, nothing, strict=True)
    )
    by_time = np.lexsort((sensor, target, t_s))
    own_kind = models[sensor[by_time]]
    return Drawn(
        t_s[by_time], target[by_time], sensor[by_time], value[by_time], own_kind, truth.target_ids
    )


def readings_of(drawn: Drawn, deployment: Deployment, steps: Steps) -> Readings:
    """Tabulate what is said in some steps."""
    low, high = np.searchsorted(drawn.t_s, [steps.t_s[0], np.nextafter(steps.t_s[-1], np.inf)])
    here = slice(int(low), int(high))
    nothing = np.full(int(high - low), np.nan)
    return Readings(
        t_s=drawn.t_s[here],
        sensor=drawn.sensor[here],
        value=drawn.value[here],
        target=drawn.target[here],
        kind=drawn.kind[here],
        sigma=nothing,
        arrival_s=nothing,
        sensor_ids=deployment.sensor_ids,
        target_ids=drawn.target_ids,
        kinds=_KINDS,
    )


def _path(scenario: Scenario, t_s: Vector, position: Matrix) -> _Path:
    still = len(position) < 2
    velocity = np.zeros_like(position) if still else np.gradient(position, scenario.step_s, axis=0)
    return _Path(t_s, position, velocity)


def _crew(model: SensorModel, sensors: NDArray[np.intp], rng: np.random.Generator) -> _Crew:
    if not isinstance(model, RssiModel):
        return _Crew(model, sensors, None)
    return _Crew(model, sensors, rssi_world.draw_shadows(model, sensors=len(sensors), rng=rng))


def _seen(crew: _Crew, sensors: Matrix, path: _Path, *, rng: np.random.Generator) -> _Seen:
    """Draw what `sensors` (k, 2) of one kind read along a path."""
    states = np.hstack([path.position, path.velocity])
    match crew.model:
        case RangeModel() as model:
            drawn = ranging.simulate(model, sensors, path=path.position, rng=rng)
        case RssiModel() as model:
            drawn = rssi_world.simulate(
                model, sensors, path=path.position, t_s=path.t_s, rng=rng, shadows=crew.shadows
            )
        case BearingModel() as model:
            drawn = bearing.simulate(model, sensors, path=path.position, rng=rng)
        case AngularRateModel() as model:
            drawn = angular_rate.simulate(model, sensors, path=states, rng=rng)
        case MotionRateModel() as model:
            drawn = motion_rate.simulate(model, sensors, path=states, rng=rng)
        case _:
            kind = kind_of(crew.model)
            raise InputError(f"found sensors of kind {kind!r}, expected one that names its target")
    return _Seen(drawn.value, drawn.heard)
