"""Binary fields in the pipeline: track-before-detect as a site tells it, with late readings."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from trackfield._core import _detect as kernel
from trackfield.association.contract import Estimates, Info
from trackfield.association.detect import (
    Detect,
    DetectSettings,
    FieldExplanation,
    ReadingScan,
)
from trackfield.association.detect_field import DetectField
from trackfield.association.model import Scene
from trackfield.errors import StateError
from trackfield.network.channel import arrived_within
from trackfield.network.site import Site, Target
from trackfield.pipeline.fronts import sensors_of
from trackfield.pipeline.scene import network_of
from trackfield.sensing.detection import DetectionModel, columns
from trackfield.types import Indices, Vector

_HISTORY = 5  # steps that hindsight reaches back, at least


class DetectState(NamedTuple):
    """The scans of the window with the states before them, oldest first; and the newest state."""

    before: tuple[kernel.State, ...]
    scans: tuple[ReadingScan, ...]
    state: kernel.State


class RewoundDetect:
    """Track-before-detect that takes late readings: back to their step, and all since again."""

    def __init__(self, detect: Detect, *, window: int, seed: int) -> None:
        self.detect, self._window, self._seed = detect, window, seed

    def initial(self) -> DetectState:
        """Make the state before the first scan."""
        return DetectState((), (), self.detect.initial(self._seed))

    def step(
        self, state: DetectState, scan: ReadingScan, late: Sequence[ReadingScan] = ()
    ) -> tuple[DetectState, Info]:
        """Take the next scan; `late` scans take the place of those of their times."""
        before, scans = list(state.before), list(state.scans)
        times = {one.t_s: place for place, one in enumerate(scans)}
        first, dropped = len(scans), 0
        for one in late:
            place = times.get(one.t_s)
            if place is None:
                dropped += 1
                continue
            scans[place] = one
            first = min(first, place)
        inner = before[first] if first < len(scans) else state.state
        for place in range(first, len(scans)):
            before[place] = inner
            inner, _ = self.detect.step(inner, scans[place])
        replayed = len(scans) - first
        before.append(inner)
        scans.append(scan)
        inner, info = self.detect.step(inner, scan)
        counts = {**info.counts, "replayed": replayed, "late": dropped}
        kept = slice(-self._window, None)
        return (
            DetectState(tuple(before[kept]), tuple(scans[kept]), inner),
            Info(counts, info.learned, info.work * (1 + replayed)),
        )

    def estimates(self, state: DetectState, lag_steps: int = 0) -> Estimates:
        """Tell what is believed of the newest scan, or in hindsight of `lag_steps` before it."""
        return self.detect.estimates(state.state, lag_steps)

    def explain(self, state: DetectState, track: int) -> FieldExplanation | None:
        """Say which sensors speak for a track; None where no track has this identity now."""
        return self.detect.explain(state.state, track)

    def encode(self, state: DetectState) -> bytes:
        """Write a state as bytes: the scans, then the state before each and the newest one."""
        n = len(state.scans[0].value) if state.scans else 0
        parts = [self.detect.encode(one) for one in (*state.before, state.state)]
        head = struct.pack("<QQ", len(state.scans), n)
        times = np.array([one.t_s for one in state.scans], "<f8").tobytes()
        values = b"".join(one.value.tobytes() for one in state.scans)
        sizes = struct.pack(f"<{len(parts)}Q", *(len(part) for part in parts))
        return b"".join((head, times, values, sizes, *parts))

    def decode(self, data: bytes) -> DetectState:
        """Read a state that `encode` wrote; `StateError` for other bytes."""
        try:
            count, n = struct.unpack_from("<QQ", data)
            times = np.frombuffer(data, "<f8", count, 16)
            at = 16 + 8 * count
            values = np.frombuffer(data, np.int8, count * n, at).reshape(count, n)
            at += count * n
            sizes = struct.unpack_from(f"<{count + 1}Q", data, at)
        except (struct.error, ValueError) as error:
            raise StateError(f"not a state of this tracker: {error}") from error
        cuts = np.cumsum([at + 8 * (count + 1), *sizes]).tolist()
        parts = [data[i:j] for i, j in pairwise(cuts)]
        *before, newest = (self.detect.decode(part) for part in parts)
        scans = [
            ReadingScan(float(t), value.copy()) for t, value in zip(times, values, strict=True)
        ]
        return DetectState(tuple(before), tuple(scans), newest)


def detector(site: Site, scene: Scene, *, seed: int, says_zero: bool) -> RewoundDetect:
    """Make track-before-detect of a site's binary sensors; settings it leaves open are the usual.

    A sensor of which nothing is heard was dead, or silent, or its message was lost; where sensors
    say their silence too (`says_zero`), not silent.
    """
    sensors = sensors_of(site, "detection")
    models = [model for model in sensors.models if isinstance(model, DetectionModel)]
    step_s = scene.reporting.step_s
    field = DetectField(
        sensors.positions,
        columns(models),
        delivery=_delivery(site)[sensors.places >= 0],
        group=_leaders(site)[sensors.places >= 0],
        region=site.reports.region,
        step_s=step_s,
        says_zero=says_zero,
    )
    window = site.tracker.window_steps
    return RewoundDetect(Detect(field, _settings(site, window)), window=window, seed=seed)


def _settings(site: Site, window: int) -> DetectSettings:
    """Take what a site tells of targets in place of what is usual on such fields."""
    told, usual, own = site.target, Target(), DetectSettings(history_steps=max(_HISTORY, window))
    changed = {
        name: getattr(told, name)
        for name in ("accel_sigma_m_s2", "velocity_sigma_m_s", "lifetime_s", "births_per_s")
        if getattr(told, name) != getattr(usual, name)
    }
    return replace(own, **changed)


def _leaders(site: Site) -> Indices:
    """Give the leader (n,) of each sensor, with which it falls silent; 0 without a network."""
    network = network_of(site)
    if network is None:
        return np.zeros(len(site.sensor_ids), np.int32)
    return np.maximum(network.routes.group, 0).astype(np.int32)


def _delivery(site: Site) -> Vector:
    """Probability (n,) that what a sensor said in a step has arrived when the step closes."""
    network = network_of(site)
    if network is None:
        return np.ones(len(site.sensor_ids))
    return arrived_within(network.channel, network.routes.hops, 0.0)
