"""What a scheduler knows and says: tracks in its own words, modes of nodes, what was told."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.association.contract import Estimates
from trackfield.errors import StateError
from trackfield.hierarchy.archive import packed, unpacked
from trackfield.motion import Motion
from trackfield.types import Gaussian, Indices, Matrix, Mode, Status, Tracks, Vector

_VERSION = 1
_ODD = 4.0  # squared innovation, the mean over the readings of an update


class Sighted(NamedTuple):
    """What a tracker tells of some tracks; rows (m,), of one track in order of time.

    `mean` (m, 4) x, y, vx, vy and `covariance` (m, 4, 4) hold at `t_s`; `status` is a `Status`: a
    confirmed row comes of a reading, others do not, and an ended track is forgotten. `odd` rows
    come of readings that contradict what was believed.
    """

    track: Indices
    t_s: Vector
    mean: Matrix
    covariance: NDArray[np.float64]
    status: Indices
    odd: NDArray[np.bool_]


class Followed(NamedTuple):
    """A track that is served: its belief at `t_s`, and how it fares.

    `asked_s` is when sensors were first asked for it since its last reading, None where it has been
    read since; `gap_s` is how far apart its readings use to be; `master` is its node, -1 for none;
    `looked` whether it was looked for in the whole field; `odd` counts its last rows that were.
    """

    t_s: float
    belief: Gaussian
    asked_s: float | None
    read_s: float
    gap_s: float
    master: int
    looked: bool
    odd: int


class State(NamedTuple):
    """What a scheduler knows between commands.

    `t_s` is the time of the last ones, None before the first; `modes` (n,) are what nodes were told
    last; all sense until `sweep_until_s`.
    """

    t_s: float | None
    modes: NDArray[np.int8]
    tracks: Mapping[int, Followed]
    sweep_until_s: float


class Service(NamedTuple):
    """Who serves a track until the next commands.

    `sensors` (k,) sense it and `master` runs its filter, -1 where nobody can; `trace_m2` is the
    trace of its position's covariance with one reading of each. It has `missed` so many intervals:
    from the second on it is looked for. `trouble` says what is not as it was asked for.
    """

    track: int
    sensors: Indices
    master: int
    trace_m2: float
    missed: int
    trouble: tuple[str, ...]


class Told(NamedTuple):
    """What one step says: modes (n,) of all nodes, and which ones are `changed` (m,) by it.

    `late` nodes sense at once that were asleep; `handovers` counts tracks whose master changed;
    `lost` are tracks that were looked for everywhere, or have left, and are served no more.
    """

    t_s: float
    modes: NDArray[np.int8]
    changed: Indices
    services: tuple[Service, ...]
    watching: bool
    sweeping: bool
    late: int
    handovers: int
    lost: tuple[int, ...]
    trouble: tuple[str, ...]


def sighted_estimates(known: Estimates) -> Sighted:
    """Take what a tracker of unknown targets shows."""
    shown = known.shown
    status = np.where(known.detected, Status.CONFIRMED, Status.COASTING).astype(np.int32)
    t_s = np.full(int(shown.sum()), known.t_s)
    return Sighted(
        known.track[shown],
        t_s,
        known.mean[shown],
        known.covariance[shown],
        status[shown],
        np.zeros(t_s.size, np.bool_),
    )


def sighted_rows(tracks: Tracks, density: float) -> Sighted:
    """Take rows of tracks.

    Rows do not say how well a velocity is known: it is taken as that of a steady filter of constant
    velocity, driven by white acceleration of `density` q [m^2/s^3], whose position has the row's
    mean variance P: (2 q^2 P)^(1/3) for each axis. A row with an innovation comes of a reading.
    """
    xx, xy, yy = tracks.covariance.T
    of_velocity = np.cbrt(density**2 * np.maximum(xx + yy, 0.0))
    covariance = np.zeros((len(tracks), 4, 4))
    covariance[:, 0, 0], covariance[:, 1, 1] = xx, yy
    covariance[:, 0, 1] = covariance[:, 1, 0] = xy
    covariance[:, 2, 2] = covariance[:, 3, 3] = of_velocity
    mean = np.column_stack([tracks.position[:, :2], tracks.velocity[:, :2]])
    young = (tracks.status == Status.TENTATIVE) & np.isfinite(tracks.nis)
    status = np.where(young, Status.CONFIRMED, tracks.status).astype(np.int32)
    with np.errstate(invalid="ignore"):  # rows without an innovation
        odd = tracks.nis > _ODD
    return Sighted(tracks.track, tracks.t_s, mean, covariance, status, odd)


def nobody() -> Sighted:
    """Tell nothing."""
    numbers = np.zeros(0, np.int32)
    return Sighted(
        numbers,
        np.zeros(0),
        np.zeros((0, 4)),
        np.zeros((0, 4, 4)),
        numbers,
        np.zeros(0, np.bool_),
    )


def joined(before: Sighted, after: Sighted) -> Sighted:
    """Put rows one below the other."""
    return Sighted(
        np.concatenate([before.track, after.track]),
        np.concatenate([before.t_s, after.t_s]),
        np.concatenate([before.mean, after.mean]),
        np.concatenate([before.covariance, after.covariance]),
        np.concatenate([before.status, after.status]),
        np.concatenate([before.odd, after.odd]),
    )


def sighted_from(plain: Sequence[Any]) -> Sighted:
    """Read rows whose columns were written as lists."""
    track, t_s, mean, covariance, status, odd = plain
    return Sighted(
        np.array(track, np.int32),
        np.array(t_s, float),
        np.array(mean, float).reshape(-1, 4),
        np.array(covariance, float).reshape(-1, 4, 4),
        np.array(status, np.int32),
        np.array(odd, bool),
    )


def merged(
    tracks: Mapping[int, Followed], rows: Sighted, *, until_s: float
) -> tuple[dict[int, Followed], dict[int, Followed], list[str]]:
    """Take rows up to `until_s` into what is known: the tracks now, those that ended, and doubts.

    Rows that are no numbers are left out and said.
    """
    now, ended, doubts = dict(tracks), dict[int, Followed](), list[str]()
    sound = np.isfinite(rows.t_s) & np.isfinite(rows.mean).all(axis=1)
    sound &= np.isfinite(rows.covariance).all(axis=(1, 2))
    sound &= rows.covariance[:, [0, 1], [0, 1]].min(axis=1, initial=np.inf) > 0.0
    for i, name in enumerate(rows.track.tolist()):
        t_s = float(rows.t_s[i])
        if rows.status[i] == Status.ENDED:
            if name in now:
                ended[name] = now.pop(name)
        elif not sound[i]:
            doubts.append(f"track {name}: found a row that is not finite, and left it out")
        elif t_s <= until_s:
            known = now.get(name)
            if known is None or t_s >= known.t_s:
                now[name] = _followed(known, rows, i)
                ended.pop(name, None)
    return now, ended, doubts


def _followed(known: Followed | None, rows: Sighted, i: int) -> Followed:
    t_s, belief = float(rows.t_s[i]), Gaussian(rows.mean[i], rows.covariance[i])
    if known is None:
        return Followed(t_s, belief, None, t_s, 0.0, -1, looked=False, odd=int(rows.odd[i]))
    if rows.status[i] != Status.CONFIRMED:
        return known._replace(t_s=t_s, belief=belief)
    odd = known.odd + 1 if rows.odd[i] else 0
    gap_s = 0.8 * known.gap_s + 0.2 * (t_s - known.read_s)
    return known._replace(
        t_s=t_s, belief=belief, asked_s=None, read_s=t_s, gap_s=gap_s, looked=False, odd=odd
    )


def carried(tracks: Iterable[Followed], motion: Motion, *, t_s: float) -> tuple[Matrix, Matrix]:
    """Carry beliefs on to `t_s`: means (m, 4) and covariances (m, 4, 4)."""
    every = list(tracks)
    means, covariances = np.empty((len(every), 4)), np.empty((len(every), 4, 4))
    steps: dict[float, tuple[Matrix, Matrix]] = {}
    for i, one in enumerate(every):
        dt_s = max(t_s - one.t_s, 0.0)
        if dt_s not in steps:
            steps[dt_s] = motion.transition(dt_s), motion.noise(dt_s)
        F, Q = steps[dt_s]
        means[i] = F @ one.belief.mean
        covariances[i] = F @ one.belief.covariance @ F.T + Q
    return means, covariances


def encode(state: State) -> bytes:
    """Write a state as bytes, versioned, not pickle."""
    head = {
        "version": _VERSION,
        "t_s": state.t_s,
        "sweep_until_s": state.sweep_until_s,
        "tracks": [[name, *_plain(one)] for name, one in state.tracks.items()],
    }
    return packed(head, [state.modes.tobytes()])


def decode(data: bytes, *, nodes: int) -> State:
    """Read a state of so many nodes that `encode` wrote; `StateError` for other bytes."""
    head, (modes,) = unpacked(data, parts=1)
    if head.get("version") != _VERSION or len(modes) != nodes:
        raise StateError("found the state of another scheduler, or of another version of it")
    tracks = {name: _followed_of(rest) for name, *rest in head["tracks"]}
    told = np.frombuffer(modes, np.int8).copy()
    if told.size and not (told.min() >= 0 and told.max() <= Mode.MASTER):
        raise StateError("found a damaged state of a scheduler: modes that there are not")
    return State(head["t_s"], told, tracks, head["sweep_until_s"])


def _plain(one: Followed) -> list[Any]:
    mean, covariance = one.belief
    return [one.t_s, mean.tolist(), covariance.tolist(), *one[2:]]


def _followed_of(plain: Sequence[Any]) -> Followed:
    t_s, mean, covariance, *rest = plain
    return Followed(t_s, Gaussian(np.array(mean), np.array(covariance)), *rest)
