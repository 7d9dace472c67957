"""Several targets at once: which messages are of which pass.

One pass gives all sensors messages of one invariant, a_max^(1/alpha) width = sqrt(c) Q / |v| with
Q = P^(1/(2 alpha)), and they agree on one trajectory. So passes are looked for one after the other,
from three loud messages of about the same invariant that agree, as far as messages join; then all
are given to the passes once more, each record's by the best assignment, until nothing changes. Two
targets of the same invariant are told apart by where they go.
"""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.localization.pass_evidence import PassEvidence, evidence, misfits
from trackfield.localization.pass_fusion import LEAST_SENSORS, Passes, PassSettings, fuse
from trackfield.localization.pass_messages import PassMessages, PassRecords
from trackfield.matching import cheapest
from trackfield.types import Indices, Vector

JOINS = 30.0  # deviance up to which a message is of a trajectory: 3 on average, 1 in a million
AGREE = 24.0  # deviance of three messages that may be of one pass: 4 on average, 1 in ten thousand
HEARD = 8.0  # deviance from silence of a message that wants an explanation
WORTH = 50.0  # deviance that a pass must explain to be one
_LOUD = 8  # messages among which three of one pass are looked for: of 3 targets, 7 hold such
_TRIED = 6  # sets of three that are followed
_ROUNDS = 6


class PassGroup(NamedTuple):
    """One pass: its `messages` (m,), numbers of rows in ascending order, and its trajectories."""

    messages: Indices
    passes: Passes


class PassGroups(NamedTuple):
    """Passes, the one that explains most first, and what none of them explains.

    `unexplained` (u,) are messages that heard something and fit no pass; `quiet` (q,) heard next to
    nothing and were given to no pass, for lack of any that they belong to.
    """

    groups: tuple[PassGroup, ...]
    unexplained: Indices
    quiet: Indices


def group(
    messages: PassMessages, record: Indices, *, settings: PassSettings | None = None
) -> PassGroups:
    """Tell which messages are of one pass, for any number of passes.

    `record` (n,) numbers the sensors' records: a pass takes at most one of the messages that a
    sensor made of one record. What heard nothing at all (amplitude 0) counts for every pass. A pass
    wants three sensors at different places.
    """
    if np.shape(record) != (len(messages.models),):
        raise InputError(f"found {np.shape(record)} records of {len(messages.models)} messages")
    given = _given(messages, np.asarray(record, np.int32), settings)
    found: list[NDArray[np.intp]] = []
    free = given.quiet_deviance > 0.0
    while len(found) < len(messages.models) // 3:
        best = _next_pass(given, free)
        if best is None:
            break
        found.append(best)
        free[best] = False
    return _settled(given, found)


class _Given(NamedTuple):
    """Messages of n sensors, with what all steps need of them."""

    messages: PassMessages
    record: Indices
    place: Indices  # that of the sensor
    settings: PassSettings | None
    evidence: PassEvidence
    quiet_deviance: Vector  # from silence; 0 for a message that heard nothing
    invariant: Vector  # its logarithm, with the standard deviation
    vague: Vector

    def fused(self, rows: NDArray[np.intp]) -> Passes:
        """Fuse messages, and those that heard nothing at all."""
        nothing = np.flatnonzero(self.quiet_deviance <= 0.0)
        return fuse(_taken(self.messages, np.sort([*rows, *nothing])), settings=self.settings)

    def deviances(self, passes: Passes, k: int = 0) -> Vector:
        """Squared misfit (n,) of every message under one of some trajectories."""
        return misfits(self.evidence, passes.theta[k], exponent=float(passes.exponent[k]))


def _given(messages: PassMessages, record: Indices, settings: PassSettings | None) -> _Given:
    about = evidence(messages)
    heard = (messages.profiles[:, 0] > 0.0) & (messages.profiles[:, 2] > 0.0)
    a, width = np.where(heard, messages.profiles[:, (0, 2)].T, 1.0)
    alpha = messages.models[0].exponent if messages.models else 1.0
    invariant = np.log(a) / alpha + np.log(width)
    vague = 2.5 / np.sqrt(np.maximum(about.loudness, 1e-6))  # as the Fisher matrix says, about
    places = np.unique(messages.sensors.reshape(-1, 2), axis=0, return_inverse=True)[1]
    own = places.reshape(-1).astype(np.int32)
    heard_deviance = about.loudness * heard
    return _Given(messages, record, own, settings, about, heard_deviance, invariant, vague)


def _next_pass(given: _Given, free: NDArray[np.bool_]) -> NDArray[np.intp] | None:
    """Messages of the pass that explains most of what is free, if any is worth it."""
    best, most = None, WORTH
    followed = 0
    for three in _agreeing(given, free):
        if best is not None and set(three) <= set(best.tolist()):
            continue
        if followed == _TRIED:
            break
        followed += 1
        rows, worth = _grown(given, free, np.array(three))
        if worth > most:
            best, most = rows, worth
    return best


def _agreeing(given: _Given, free: NDArray[np.bool_]) -> list[tuple[int, ...]]:
    """Find sets of three loud messages that may be of one pass; those that say most first."""
    loud = np.flatnonzero(free & (given.quiet_deviance > HEARD))
    loud = loud[np.argsort(-given.quiet_deviance[loud], kind="stable")][:_LOUD]
    ranked: list[tuple[float, tuple[int, ...]]] = []
    for three in combinations(loud.tolist(), 3):
        rows = list(three)
        if len(set(given.place[rows].tolist())) < 3:
            continue
        spread = np.abs(given.invariant[rows] - np.median(given.invariant[rows])).max()
        if spread > 0.2 + 3.0 * given.vague[rows].max():
            continue
        passes = given.fused(np.array(rows))
        if len(passes.theta) and passes.deviance[0].sum() < AGREE:
            worth = given.quiet_deviance[rows].sum() - 4.0 * passes.deviance[0].sum()
            ranked.append((-float(worth), three))
    return [three for _, three in sorted(ranked)]


def _grown(
    given: _Given, free: NDArray[np.bool_], three: NDArray[np.intp]
) -> tuple[NDArray[np.intp], float]:
    """Let messages join the trajectories of three, as long as that changes anything."""
    best: tuple[NDArray[np.intp], float] = (three, 0.0)
    first = given.fused(three)
    for k in range(min(len(first.theta), 3)):
        passes, which, rows, limit = first, k, three, 3.0 * JOINS
        for _ in range(_ROUNDS):
            deviance = np.where(free, given.deviances(passes, which), np.inf)
            joined = _one_a_record(deviance, given.record, limit)
            if _too_few(given, joined) or np.array_equal(joined, rows):
                break
            rows, limit = joined, JOINS
            passes, which = given.fused(rows), 0
            if not len(passes.theta):
                break
        if len(passes.theta):
            deviance = given.deviances(passes, which)[rows]
            rows, deviance = rows[deviance < JOINS], deviance[deviance < JOINS]
            worth = float((np.minimum(given.quiet_deviance[rows], JOINS) - deviance).sum())
            if not _too_few(given, rows) and worth > best[1]:
                best = (rows, worth)
    return best


def _too_few(given: _Given, rows: NDArray[np.intp]) -> bool:
    return np.unique(given.place[rows]).size < LEAST_SENSORS


def _one_a_record(deviance: Vector, record: Indices, limit: float) -> NDArray[np.intp]:
    """Rows of each record's best message, if its deviance is below `limit`."""
    order = np.lexsort((deviance, record))
    first = np.concatenate([[True], np.diff(record[order]) != 0])
    best = order[first]
    return np.sort(best[deviance[best] < limit])


def _settled(given: _Given, found: list[NDArray[np.intp]]) -> PassGroups:
    """Give every message to the pass that explains it best, until nothing changes."""
    n = len(given.record)
    owner = np.full(n, -1)
    for _ in range(_ROUNDS):
        before = owner.copy()
        passes = [given.fused(rows) for rows in found]
        owner = _assigned(given, passes) if passes else owner
        found = [np.flatnonzero(owner == k) for k in range(len(found))]
        kept = [k for k, rows in enumerate(found) if not _too_few(given, rows)]
        if len(kept) == len(found) and np.array_equal(owner, before):
            break
        found = [found[k] for k in kept]
    loudest = sorted(found, key=lambda rows: (-float(given.quiet_deviance[rows].sum()), rows[0]))
    groups = tuple(PassGroup(rows.astype(np.int32), given.fused(rows)) for rows in loudest)
    left = np.ones(n, bool)
    for rows in found:
        left[rows] = False
    heard = given.quiet_deviance > HEARD
    return PassGroups(groups, _numbers(left & heard), _numbers(left & ~heard))


def _assigned(given: _Given, passes: list[Passes]) -> NDArray[np.intp]:
    """Pass of each message (n,), -1 for none: of a record's messages no two to one pass."""
    deviance = np.stack([given.deviances(one) for one in passes])  # (passes, n)
    owner = np.full(given.record.size, -1)
    which, row = np.nonzero((deviance < JOINS) & (given.quiet_deviance > 0.0))
    seat = given.record[row] * len(passes) + which  # a pass is once in a record
    chosen = cheapest(seat, row, deviance[which, row], alone=JOINS)
    owner[row[chosen]] = which[chosen]
    return owner


def _taken(messages: PassMessages, rows: NDArray[np.intp]) -> PassMessages:
    return messages._replace(
        sensors=messages.sensors[rows],
        models=tuple(messages.models[int(row)] for row in rows),
        profiles=messages.profiles[rows],
        records=PassRecords(*(column[rows] for column in messages.records)),
    )


def _numbers(mask: NDArray[np.bool_]) -> Indices:
    return np.flatnonzero(mask).astype(np.int32)
