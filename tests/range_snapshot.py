"""The bytes of the compiled tracker's snapshot, laid open: every number can be read and rewritten.

Arrays are views of the bytes, so that a test can put a belief where no reading would.
"""

import struct
from typing import NamedTuple

import numpy as np

MODES = 4


class Slot(NamedTuple):
    sensor: int
    last: float
    weight: float
    power: float


class Belief(NamedTuple):
    t: float
    alive: int
    track: int
    step: int
    last_update: float
    probability: np.ndarray  # (MODES,)
    modes: list  # (mean (n,), covariance (n, n)) each
    mean: np.ndarray
    covariance: np.ndarray
    slots: list
    pool: np.ndarray  # weight, power
    heard: np.ndarray  # all, late, outlying
    surprises: int  # bits, newest lowest
    pending: int


class Target(NamedTuple):
    belief: Belief
    checkpoints: int
    window: int
    recent: int


class Opened(NamedTuple):
    """A kernel's snapshot; `data` are the bytes that the arrays are views of."""

    data: bytearray
    targets: list


def opened(snapshot: bytes) -> Opened:
    """Lay open what `RangeBank.snapshot` gave."""
    reader = _Reader(bytearray(snapshot))
    targets = [_target(reader) for _ in range(reader.one("Q"))]
    return Opened(reader.data, targets)


def rewritten(snapshot: bytes, target: int, mean, covariance) -> bytes:
    """Put one belief N(mean, covariance) of position and velocity into every mode of a target."""
    state = opened(snapshot)
    belief = state.targets[target].belief
    k = len(mean)
    wholes = [(m, P) for m, P in belief.modes if m.size] + [(belief.mean, belief.covariance)]
    for m, P in wholes:
        m[:k] = mean
        P[:k, :k] = covariance
    return bytes(state.data)


class _Reader:
    def __init__(self, data: bytearray) -> None:
        self.data, self.at = data, 0

    def one(self, code: str):
        (value,) = struct.unpack_from("<" + code, self.data, self.at)
        self.at += struct.calcsize("<" + code)
        return value

    def several(self, codes: str) -> list:
        return [self.one(code) for code in codes]

    def view(self, count: int, dtype=np.float64) -> np.ndarray:
        array = np.frombuffer(self.data, dtype, count, self.at)
        self.at += array.nbytes
        return array

    def vector(self, dtype=np.float64) -> np.ndarray:
        return self.view(self.one("Q"), dtype)


def _belief(r: _Reader) -> Belief:
    t, alive, track, step, last_update = r.several("d?iqd")
    probability, modes = np.empty(MODES), []
    for j in range(MODES):
        probability[j] = r.one("d")
        modes.append(_moments(r))
    mean, covariance = _moments(r)
    slots = [Slot(*r.several("iddd")) for _ in range(r.one("Q"))]
    pool, heard, surprises = r.view(2), r.view(3), r.one("I")
    pending = r.one("Q")
    for _ in range(pending):
        r.several("dqid")
        for _ in range(3):
            r.vector()
    fields = (probability, modes, mean, covariance, slots, pool, heard, surprises, pending)
    return Belief(t, alive, track, step, last_update, *fields)


def _moments(r: _Reader) -> tuple[np.ndarray, np.ndarray]:
    mean = r.vector()
    return mean, r.vector().reshape(mean.size, mean.size)


def _readings(r: _Reader) -> int:
    count = r.one("Q")
    for _ in range(count):
        r.several("ddfi")
    return count


def _state(r: _Reader) -> tuple[Belief, int]:
    belief, recent = _belief(r), _readings(r)
    r.several("iiid")
    return belief, recent


def _target(r: _Reader) -> Target:
    checkpoints = r.one("Q")
    for _ in range(checkpoints):
        r.one("d")
        _state(r)
    r.several("ii")
    belief, recent = _state(r)
    window, _ = _readings(r), _readings(r)
    r.several("iddd")
    return Target(belief, checkpoints, window, recent)
