"""The state of MCMCDA as a value, and as bytes."""

from __future__ import annotations

import io
import zipfile
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.association.contract import ReportScan
from trackfield.association.window_learning import Learned
from trackfield.errors import StateError
from trackfield.types import Indices

_HEAD = b"trackfield.mcmcda.1\n"


class State(NamedTuple):
    """The window's scans, the best partition of their reports, and what else a step needs.

    `owner` and `track` (n,) are the number of each report's track, -1 of none, and its identity, 0
    of none; `samples` (S, n) are partitions that the chain went through; `names` and `first_s` (K,)
    the identities of the tracks and when they were first seen; `random` four words; `begins` tells
    that the window's first scan is the run's first.
    """

    scans: tuple[ReportScan, ...]
    owner: Indices
    track: Indices
    samples: NDArray[np.int16]
    names: Indices
    first_s: tuple[float, ...]
    next_track: int
    random: tuple[int, ...]
    learned: Learned
    begins: bool


def encode(state: State) -> bytes:
    """Write a state as bytes, arrays of NumPy behind a line that names the version."""
    file = io.BytesIO()
    np.savez(
        file,
        t_s=np.array([scan.t_s for scan in state.scans]),
        sizes=np.array([len(scan.number) for scan in state.scans], np.int64),
        position=np.concatenate([np.zeros((0, 2)), *(scan.position for scan in state.scans)]),
        covariance=np.concatenate([np.zeros((0, 3)), *(scan.covariance for scan in state.scans)]),
        number=np.concatenate([np.zeros(0, np.int32), *(scan.number for scan in state.scans)]),
        owner=state.owner,
        track=state.track,
        samples=state.samples,
        names=state.names,
        first_s=np.array(state.first_s, float),
        next_track=np.array(state.next_track),
        random=np.array(state.random, np.uint64),
        learned=np.array(state.learned, float),
        begins=np.array(state.begins),
    )
    return _HEAD + file.getvalue()


def decode(data: bytes) -> State:
    """Read a state that `encode` wrote; `StateError` for other bytes."""
    if not data.startswith(_HEAD):
        raise StateError(f"not a state of MCMCDA that this version can read: {data[:24]!r}")
    try:
        with np.load(io.BytesIO(data[len(_HEAD) :]), allow_pickle=False) as file:
            return _state({name: file[name] for name in file.files})
    except (ValueError, KeyError, TypeError, EOFError, OSError, zipfile.BadZipFile) as error:
        raise StateError(f"a damaged state of MCMCDA: {error}") from error


def _state(file: dict[str, NDArray[Any]]) -> State:
    ends = np.cumsum(file["sizes"])[:-1]
    columns = [np.split(file[name], ends) for name in ("position", "covariance", "number")]
    rows = zip(file["t_s"], *columns, strict=False)  # no scans split into one empty part
    scans = tuple(ReportScan(float(t), *row) for t, *row in rows)
    return State(
        scans=scans,
        owner=file["owner"],
        track=file["track"],
        samples=file["samples"],
        names=file["names"],
        first_s=tuple(file["first_s"].tolist()),
        next_track=int(file["next_track"]),
        random=tuple(file["random"].tolist()),
        learned=Learned(*file["learned"].tolist()),
        begins=bool(file["begins"]),
    )
