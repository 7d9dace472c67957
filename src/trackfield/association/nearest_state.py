"""What a nearest-neighbour tracker holds between scans, and its bytes."""

from __future__ import annotations

import io
import math
import zipfile
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.association.contract import ReportScan
from trackfield.association.rewind import Kept, Window
from trackfield.errors import StateError
from trackfield.types import Arrays, Indices, Matrix, Vector

_VERSION = 1


class Held(NamedTuple):
    """Tracks after the scan of time `t_s` (-inf before the first); one entry a track.

    `mean` (n, 4) x, y, vx, vy with `covariance` (n, 4, 4); `recent` (n, N) are the numbers of the
    reports of the last N steps, the newest last, -1 for none; `age` (n,) counts the steps since the
    first report, `missed` (n,) those since the last. `pairs` and `crowded` count gated pairs and
    reports that found no room.
    """

    t_s: float
    track: Indices
    mean: Matrix
    covariance: NDArray[np.float64]
    first_s: Vector
    recent: Indices
    age: Indices
    missed: Indices
    confirmed: NDArray[np.bool_]
    pairs: int
    crowded: int


NearestState = Window[Held]
"""The scans of the window with the tracks before each, and the tracks after all of them."""


def no_tracks(recent: int) -> Held:
    """Hold no track; `recent` is N."""
    return Held(
        t_s=-math.inf,
        track=np.empty(0, np.int32),
        mean=np.empty((0, 4)),
        covariance=np.empty((0, 4, 4)),
        first_s=np.empty(0),
        recent=np.empty((0, recent), np.int32),
        age=np.empty(0, np.int32),
        missed=np.empty(0, np.int32),
        confirmed=np.empty(0, np.bool_),
        pairs=0,
        crowded=0,
    )


_COLUMNS = ("track", "mean", "covariance", "first_s", "recent", "age", "missed", "confirmed")
_SCAN_COLUMNS = ("position", "covariance", "number")


def encode(state: NearestState) -> bytes:
    """Write a state as bytes: arrays of NumPy without pickle."""
    held = [*(kept.before for kept in state.kept), state.state]
    scans = [kept.scan for kept in state.kept]
    columns: Arrays = {
        "version": np.array(_VERSION),
        "tracks": np.array([one.track.size for one in held]),
        "numbers": np.array([(one.t_s, one.pairs, one.crowded) for one in held]),
        "reports": np.array([scan.number.size for scan in scans], np.int64),
        "times": np.array([scan.t_s for scan in scans], np.float64),
    }
    for name in _COLUMNS:
        columns[name] = np.concatenate([getattr(one, name) for one in held])
    for name in _SCAN_COLUMNS:
        parts = [getattr(scan, name) for scan in scans]
        columns[f"scan_{name}"] = np.concatenate(parts) if parts else np.empty(0)
    file = io.BytesIO()
    np.savez(file, allow_pickle=False, **columns)
    return file.getvalue()


def decode(data: bytes, recent: int) -> NearestState:
    """Read what `encode` wrote of tracks with N = `recent`; `StateError` for other bytes."""
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            columns: Arrays = {name: file[name] for name in file.files}
        if int(columns["version"]) != _VERSION:
            raise StateError(f"version {_VERSION} expected, found {columns['version']}")
        if columns["recent"].shape[1] != recent:
            raise StateError(
                f"tracks that remember {recent} steps expected, found {columns['recent'].shape[1]}"
            )
        *before, newest = _held(columns)
        pairs = zip(before, _scans(columns), strict=True)
    except (KeyError, ValueError, IndexError, EOFError, OSError, zipfile.BadZipFile) as error:
        raise StateError(f"not a state of this tracker: {error}") from error
    return Window(tuple(Kept(one, scan) for one, scan in pairs), newest)


def _held(columns: Arrays) -> list[Held]:
    parts = {name: _parts(columns[name], columns["tracks"]) for name in _COLUMNS}
    return [
        Held(
            t_s=float(t_s),
            pairs=int(pairs),
            crowded=int(crowded),
            **{name: parts[name][i] for name in _COLUMNS},
        )
        for i, (t_s, pairs, crowded) in enumerate(columns["numbers"])
    ]


def _scans(columns: Arrays) -> list[ReportScan]:
    parts = [_parts(columns[f"scan_{name}"], columns["reports"]) for name in _SCAN_COLUMNS]
    return [
        ReportScan(float(t_s), *scan) for t_s, *scan in zip(columns["times"], *parts, strict=True)
    ]


def _parts(column: NDArray[Any], sizes: NDArray[Any]) -> list[NDArray[Any]]:
    if not sizes.size:
        return []
    if int(sizes.sum()) != len(column):
        raise ValueError(f"found {len(column)} rows, expected {int(sizes.sum())}")
    return np.split(column, np.cumsum(sizes)[:-1])
