"""A node's front end: a raw waveform in, a detection per reporting window out, Oh V.A.

Either a fixed threshold on the raw value, which was easy to tune on the day of the demonstration;
or filter, adaptive threshold and window, which drift and weather do not fool. For PIR, acoustic or
any other waveform; both run on a stream, window by window.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple, cast

import numpy as np
import scipy.signal
from numpy.typing import NDArray

from trackfield.errors import ConfigurationError, InputError
from trackfield.types import Matrix, Vector

_signal = cast("Any", scipy.signal)  # its filters have no types

_GAUSSIAN_MEDIAN = 0.6745  # median of |x| for N(0, 1)
_SLOW = 0.1  # how much less a window that detects moves the noise level
_ORDER = 2


@dataclass(frozen=True, slots=True)
class FixedThreshold:
    """1 where |x - rest| > `threshold` at some sample of the window, in the waveform's unit."""

    threshold: float
    rest: float = 0.0


@dataclass(frozen=True, slots=True)
class AdaptiveThreshold:
    """1 where |band-passed x| exceeds factor times the noise's sigma for a share of the window.

    The noise's sigma is learned from the median of |x| window by window and forgotten over
    `memory_s`, ten times slower while something is detected; it is never below `least_sigma`, in
    the waveform's unit, so that a resolution step of the converter is no event.
    """

    band_hz: tuple[float, float] = (0.3, 4.0)
    factor: float = 4.0
    share: float = 0.1
    memory_s: float = 60.0
    least_sigma: float = 1e-3


PIR = AdaptiveThreshold()
"""A person walking past a passive infrared sensor, waveform in volts."""
ACOUSTIC = AdaptiveThreshold(band_hz=(80.0, 800.0), factor=3.0, share=0.05)
"""A vehicle or steps past a microphone, waveform in units of full scale."""


@dataclass(frozen=True, slots=True)
class FrontEnd:
    """What a node runs: samples at `rate_hz`, a detector, a report every `window_s`."""

    rate_hz: float
    detector: FixedThreshold | AdaptiveThreshold = PIR
    window_s: float = 1.0

    @property
    def window_samples(self) -> int:
        """Samples in a window."""
        return round(self.window_s * self.rate_hz)


class FrontEndState(NamedTuple):
    """All that the next samples need: those short of a window, the filter, what noise is usual."""

    left: Vector
    windows: int
    filter: Matrix  # (sections, 2); empty before the first window
    sigma: float


class Windows(NamedTuple):
    """What a node says, one entry a window, (k,).

    `end_s` after the first sample; `detected`; `level` is what was compared with `threshold` (the
    largest deviation for a fixed threshold, the deviation that `share` of the window exceeds for an
    adaptive one); `constant` tells a window that holds one value only, a sensor that is stuck.
    """

    end_s: Vector
    detected: NDArray[np.bool_]
    level: Vector
    threshold: Vector
    constant: NDArray[np.bool_]


def initial(front: FrontEnd) -> FrontEndState:
    """State before the first sample; `ConfigurationError` names what cannot be in a front end."""
    problems = _problems(front)
    if problems:
        raise ConfigurationError(problems)
    return FrontEndState(np.empty(0), 0, np.empty((0, 2)), 0.0)


def step(front: FrontEnd, state: FrontEndState, chunk: Vector) -> tuple[FrontEndState, Windows]:
    """Take any number of samples (m,); say what the windows held that are complete with them.

    However a waveform is cut into chunks, the windows are the same. `InputError` for samples that
    are not numbers.
    """
    samples = np.asarray(chunk, float)
    if samples.ndim != 1:
        raise InputError(f"waveform: found shape {samples.shape}, expected (n,)")
    bad = np.flatnonzero(~np.isfinite(samples))
    if bad.size:
        raise InputError(
            f"waveform: found {samples[bad[0]]} at sample {bad[0]}, expected finite numbers"
        )
    samples = np.concatenate([state.left, samples])
    size = front.window_samples
    count = samples.size // size
    whole = samples[: count * size].reshape(count, size)
    level, threshold = np.empty(count), np.empty(count)
    for i, window in enumerate(whole):
        state, level[i], threshold[i] = _window(front, state, window)
    before = state.windows - count
    end_s = (before + np.arange(1.0, count + 1.0)) * (size / front.rate_hz)
    windows = Windows(end_s, level > threshold, level, threshold, np.ptp(whole, axis=1) == 0.0)
    return state._replace(left=samples[count * size :].copy()), windows


def detect(front: FrontEnd, waveform: Vector) -> Windows:
    """Run a whole waveform (n,) through a front end; an incomplete last window is left out.

    `InputError` where it is shorter than a window or holds one value only.
    """
    state = initial(front)
    size = front.window_samples
    if np.size(waveform) < size:
        raise InputError(
            f"waveform: found {np.size(waveform)} samples, expected at least a window of {size}"
        )
    _, found = step(front, state, waveform)
    if found.constant.all() and np.ptp(waveform) == 0.0:
        raise InputError(
            f"waveform: found the value {float(waveform[0]):g} throughout, expected a signal: the "
            "sensor is stuck or not connected"
        )
    return found


def join_windows(parts: Iterable[Windows]) -> Windows:
    """Join the windows of a stream in their order."""
    return Windows(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _window(
    front: FrontEnd, state: FrontEndState, window: Vector
) -> tuple[FrontEndState, float, float]:
    """State after a window, its level, and what that was compared with."""
    detector = front.detector
    windows = state.windows + 1
    if isinstance(detector, FixedThreshold):
        level = float(np.abs(window - detector.rest).max())
        return state._replace(windows=windows), level, detector.threshold
    filtered, memory = _filtered(front.rate_hz, detector.band_hz, state, window=window)
    size = np.abs(filtered)
    here = max(float(np.median(size)) / _GAUSSIAN_MEDIAN, detector.least_sigma)
    sigma = state.sigma if state.windows else here
    level = float(np.quantile(size, 1.0 - detector.share))
    threshold = detector.factor * sigma
    # A running mean at first, so that the first window does not count for more than the next ones.
    gain = max(front.window_s / detector.memory_s, 1.0 / windows)
    if level > threshold:
        gain *= _SLOW
    sigma = math.exp((1.0 - gain) * math.log(sigma) + gain * math.log(here))
    return FrontEndState(state.left, windows, memory, sigma), level, threshold


def _filtered(
    rate_hz: float, band_hz: tuple[float, float], state: FrontEndState, *, window: Vector
) -> tuple[Vector, Matrix]:
    """Band-pass of the next window, and the filter's memory after it."""
    sections = _sections(rate_hz, band_hz)
    memory = state.filter
    if not state.windows:  # as if the first value had stood for ever: no transient
        memory = _signal.sosfilt_zi(sections) * window[0]
    filtered, memory = _signal.sosfilt(sections, window, zi=memory)
    return np.asarray(filtered, float), np.asarray(memory, float)


@lru_cache
def _sections(rate_hz: float, band_hz: tuple[float, float]) -> Matrix:
    """Coefficients of the band-pass: designing it takes longer than a window's filtering."""
    return np.asarray(_signal.butter(_ORDER, band_hz, "bandpass", fs=rate_hz, output="sos"), float)


def _problems(front: FrontEnd) -> list[str]:
    found: list[str] = []

    def demand(name: str, value: float, *, least: float = 0.0, most: float = math.inf) -> None:
        if not (least < value <= most and math.isfinite(value)):
            limit = "" if most == math.inf else f", at most {most:g}"
            found.append(f"{name}: found {value:g}, expected more than {least:g}{limit}")

    demand("rate_hz", front.rate_hz)
    demand("window_s", front.window_s)
    if not found and front.window_samples < 2:
        found.append(
            f"window_s: found {front.window_samples} samples in {front.window_s:g} s at "
            f"{front.rate_hz:g} Hz, expected at least 2"
        )
    if isinstance(front.detector, FixedThreshold):
        demand("threshold", front.detector.threshold)
        demand("rest", front.detector.rest, least=-math.inf)
        return found
    low, high = front.detector.band_hz
    if not 0.0 < low < high < front.rate_hz / 2.0:
        found.append(
            f"band_hz: found {low:g} to {high:g}, expected more than 0, ascending, and less than "
            f"half of rate_hz = {front.rate_hz:g}"
        )
    demand("factor", front.detector.factor)
    demand("share", front.detector.share, most=1.0)
    demand("memory_s", front.detector.memory_s)
    demand("least_sigma", front.detector.least_sigma)
    return found
