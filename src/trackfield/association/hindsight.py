"""What a window of partitions tells: where targets are or were, how surely, by which reports."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.association.contract import Alternative, Estimates, Explanation
from trackfield.association.mcmcda_state import State
from trackfield.association.partition import Followed, Window, follow
from trackfield.association.sampling import Sampling
from trackfield.errors import InputError
from trackfield.types import Indices, Vector

_LEAST_EXISTENCE = 1e-3
_EXPLAINED_SLOTS = 5


def table(window: Window, owner: NDArray[np.signedinteger]) -> Indices:
    """List the reports of tracks by slot, (K, T), -1 of none, from the track of each, (n,)."""
    out = np.full((int(owner.max(initial=-1)) + 1, window.t_s.size), -1, np.int32)
    mine = np.flatnonzero(owner >= 0)
    out[owner[mine], window.slot[mine]] = mine
    return out


def estimates(window: Window, state: State, sampling: Sampling, *, lag_steps: int) -> Estimates:
    """Tell the targets of the slot `lag_steps` before the last; `InputError` if there is none."""
    slot = window.t_s.size - 1 - lag_steps
    if lag_steps < 0 or slot < 0:
        raise InputError(
            f"a lag of {lag_steps} steps: expected 0 to {window.t_s.size - 1}, "
            "what the window holds"
        )
    tracks = table(window, state.owner)
    found = follow(window, tracks, slot)
    if sampling.output == "mean" and len(tracks):
        found = _averaged(window, state, tracks, slot)
    existence = found.existence
    first = (tracks >= 0).argmax(axis=1)
    if not sampling.existence:
        existence = _seen_lately(tracks, slot, sampling.coast)
    rows = np.flatnonzero((existence > _LEAST_EXISTENCE) & (first <= slot))
    return Estimates(
        t_s=float(window.t_s[slot]),
        track=state.names[rows],
        existence=existence[rows],
        mean=found.mean[rows],
        covariance=found.covariance[rows],
        first_s=np.array(state.first_s, float)[rows],
        detected=tracks[rows, slot] >= 0,
        shown=existence[rows] > sampling.show,
    )


def explain(window: Window, state: State, sampling: Sampling, *, track: int) -> Explanation | None:
    """Tell by which reports of the last slots a track is there, over the sampled partitions."""
    places = np.flatnonzero(state.names == track)
    if places.size == 0:
        return None
    k = int(places[0])
    told = estimates(window, state, sampling, lag_steps=0)
    mine = np.flatnonzero(told.track == track)
    every = _in_samples(window, state, table(window, state.owner)[k : k + 1])
    recent = every.tracks[:, -_EXPLAINED_SLOTS:]
    ways, which = np.unique(recent, axis=0, return_inverse=True)
    shares = np.bincount(which.ravel(), weights=every.shares, minlength=len(ways))
    numbers = np.append(np.concatenate([scan.number for scan in state.scans]), -1)
    order = np.argsort(-shares, kind="stable")
    return Explanation(
        track=track,
        existence=float(told.existence[mine[0]]) if mine.size else 0.0,
        first_s=state.first_s[k],
        alternatives=tuple(
            Alternative(float(shares[way]), tuple(numbers[ways[way]].tolist())) for way in order
        ),
    )


class _Sampled(NamedTuple):
    """Different `tracks` (B, T) in the samples: which best track each is, in what share."""

    tracks: Indices
    best: NDArray[np.intp]
    shares: Vector


def _in_samples(window: Window, state: State, tracks: Indices) -> _Sampled:
    """For each best track and sample, the track that has its last report there, if one has."""
    slots = tracks.shape[1]
    last = slots - 1 - (tracks[:, ::-1] >= 0).argmax(axis=1)
    key = tracks[np.arange(len(tracks)), last]
    rows: list[Indices] = []
    best: list[NDArray[np.intp]] = []
    for sample in state.samples:
        every = table(window, sample)
        owner = sample[key]
        rows.append(every[owner[owner >= 0]])
        best.append(np.flatnonzero(owner >= 0))
    joined = np.column_stack([np.concatenate(best), np.concatenate(rows)])
    different, counts = np.unique(joined, axis=0, return_counts=True)
    shares = counts / len(state.samples)
    return _Sampled(different[:, 1:].astype(np.int32), different[:, 0].astype(np.intp), shares)


def _averaged(window: Window, state: State, tracks: Indices, slot: int) -> Followed:
    """Moments over the sampled partitions of the target that each best track tells of."""
    every = _in_samples(window, state, tracks)
    found = follow(window, every.tracks, slot)
    weight = every.shares * found.existence
    existence = np.zeros(len(tracks))
    np.add.at(existence, every.best, weight)
    share = weight / np.maximum(existence, 1e-300)[every.best]
    mean = np.zeros((len(tracks), 4))
    covariance = np.zeros((len(tracks), 4, 4))
    np.add.at(mean, every.best, share[:, None] * found.mean)
    offset = found.mean - mean[every.best]
    spread = found.covariance + offset[:, :, None] * offset[:, None, :]
    np.add.at(covariance, every.best, share[:, None, None] * spread)
    log_ratio = np.zeros(len(tracks))
    np.add.at(log_ratio, every.best, every.shares * found.log_ratio)
    return Followed(log_ratio, existence, mean, covariance)


def _seen_lately(tracks: Indices, slot: int, coast: int) -> Vector:
    """1 for tracks with a report in `slot` or the `coast` slots before, or between two; else 0."""
    there = tracks >= 0
    recent = there[:, max(0, slot - coast) : slot + 1].any(axis=1)
    between = there[:, :slot].any(axis=1) & there[:, slot + 1 :].any(axis=1)
    return (recent | between).astype(float)
