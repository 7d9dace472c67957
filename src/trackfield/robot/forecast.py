"""How far a target's path can be foretold: forecasts that were put to the test so far."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackfield.robot import waves
from trackfield.robot.waves import Waves
from trackfield.types import Matrix, Vector

KEPT = 128  # samples; when they are so many every other one goes
_TESTED = 64  # fits of a kind that are still put to the test
_RECENT = 6  # samples of the straight line
_EXACT = 1e-3  # of the tolerance: who errs by no more is believed at any lead
_LEADS: Vector = np.append(np.arange(1.0, 25.0), np.arange(27.0, 400.0, 3.0))
"""Samples ahead; far ones are thin."""


@dataclass(frozen=True, slots=True)
class Foresight:
    """How far forecasts are believed, in samples: up to `most`, and as `forecast` says."""

    most: int = 200
    reach: float = 4.0
    skill: float = 0.35


class Forecast(NamedTuple):
    """Where a target will be: `t_s` (k,) and `position` (k, 2) [m]; k = 0 where nothing is sure."""

    t_s: Vector
    position: Matrix


class Memory(NamedTuple):
    """What was seen, thinned to equal spacing, and the fits made of it, a stack a kind of fit."""

    t_s: Vector
    position: Matrix
    spacing_s: float
    fits: tuple[Waves, ...]


NOTHING = Memory(
    np.empty(0),
    np.empty((0, 2)),
    0.0,
    (Waves(np.empty(0), np.empty((0, 2)), np.empty((0, 4, 2))),) * 3,
)


def seen(memory: Memory, t_s: float, position: Vector) -> Memory:
    """Remember a target at `position` (2,) [m] at `t_s`, and fit its path anew.

    Memory and time are bounded: a sample that comes sooner than the spacing is let go, and when
    `KEPT` are kept the spacing doubles.
    """
    if memory.t_s.size and t_s - memory.t_s[-1] < memory.spacing_s * (1.0 - 1e-6):
        return memory
    t, p = np.append(memory.t_s, t_s), np.vstack([memory.position, position])
    spacing, fits = memory.spacing_s, memory.fits
    if t.size == 2:
        spacing = float(t[1] - t[0])
    if t.size >= waves.FEWEST:
        line = waves.fit_line(t[-_RECENT:], p[-_RECENT:])
        new = waves.fit_wave(t, p), waves.fit_axes(t, p), line
        fits = tuple(_latest(old, fit) for old, fit in zip(fits, new, strict=True))
    if t.size >= KEPT:
        t, p, spacing = t[1::2], p[1::2], 2.0 * spacing
        fits = tuple(Waves(*(part[1::2] for part in stack)) for stack in fits)
    return Memory(t, p, spacing, fits)


def forecast(memory: Memory, t_s: float, *, tolerance_m: float, foresight: Foresight) -> Forecast:
    """Foretell where the target will be after `t_s`, as far as that held so far.

    A kind of fit is believed `reach` times as far ahead as all of its latest fits foretold what
    came since within `tolerance_m`, at every lead, and without limit where they were exact; the
    kind that is believed farthest is asked. None is believed whose errors are more than `skill` of
    how far the target moved: it knows no more than that the target stays near.
    """
    if not memory.fits[0].t_s.size:
        return Forecast(np.empty(0), np.empty((0, 2)))
    believed = [_believed(stack, memory, tolerance_m, foresight) for stack in memory.fits]
    kind = int(np.argmax(believed))
    lead = _LEADS[min(believed[kind], foresight.most) >= _LEADS]
    t = t_s + memory.spacing_s * lead
    last = Waves(*(part[-1:] for part in memory.fits[kind]))
    return Forecast(t, waves.at(last, t)[0])


def _latest(stack: Waves, fit: Waves) -> Waves:
    return Waves(*(part[-_TESTED:] for part in waves.join([stack, fit])))


def _believed(stack: Waves, memory: Memory, tolerance_m: float, foresight: Foresight) -> float:
    """How many samples ahead this kind of fit is believed."""
    count = stack.t_s.size - 1  # the last one has foretold nothing yet
    if count < 1:
        return 0.0
    t, p = memory.t_s[-count:], memory.position[-count:]
    past = Waves(*(part[:-1] for part in stack))
    since = t > past.t_s[:, None]
    error = np.linalg.norm(waves.at(past, t) - p, axis=-1) * since
    fine = (error <= tolerance_m).all(axis=1)
    held = count if fine.all() else int(np.argmin(fine[::-1]))
    if not held:
        return 0.0
    error, since = error[-held:, -held:], since[-held:, -held:]
    moved = np.linalg.norm(p[-held:] - memory.position[-1 - held : -1, None], axis=-1) * since
    if np.linalg.norm(error) > foresight.skill * np.linalg.norm(moved):
        return 0.0
    return np.inf if error.max() <= _EXACT * tolerance_m else foresight.reach * held
