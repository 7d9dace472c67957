"""A tracking group: tracks what its own sensors report, and hands over what leaves its cell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from trackfield.association.contract import AnyAssociator, Estimates, Info, ReportScan
from trackfield.association.model import Targets
from trackfield.hierarchy.estimates import joined, selected
from trackfield.hierarchy.handover import (
    Handover,
    claims,
    estimates_of,
    messages_of,
    newest,
    predicted,
)
from trackfield.raster import Region

_FORGET = 0.05  # existence under which a handed-over target that nobody found is given up
_CREDIBLE = 0.1  # existence from which a track may stand for a target that was handed over


class Name(NamedTuple):
    """Identity of a target in the whole field, and when whoever named it had first seen it."""

    since_s: float
    target: int


class GroupState(NamedTuple):
    """What a group knows: its tracker's state, which tracks are whose, and who is expected.

    `names` maps the tracker's own track numbers to names in the whole field, of which the group has
    `given` so many itself; `pending` holds targets that were handed over and that no own track
    stands for yet.
    """

    tracker: Any
    names: Mapping[int, Name]
    given: int
    pending: tuple[Handover, ...]


class GroupReport(NamedTuple):
    """What a group tells the base after a step.

    `estimates` are its own, with `track` holding identities in the whole field, and those of the
    targets that it expects; `renamed` lists (identity, former identity) where a hand-over came
    after a track of its own had begun.
    """

    group: int
    estimates: Estimates
    renamed: tuple[tuple[int, int], ...]


class GroupStep(NamedTuple):
    """Outcome of a step: what goes to the base, to each neighbour, and what happened."""

    report: GroupReport
    handovers: Mapping[int, tuple[Handover, ...]]
    info: Info


class TrackingGroup(NamedTuple):
    """The tracking group of leader `group`: any tracker of its scene, in its cell.

    A target whose next position is predicted in another group's region (of `regions`, what each
    hears of) is handed over to that group, each step anew while that holds, so that a message that
    is lost does no harm. A target that is expected and not found in a step, though the group would
    have seen it with `p_found`, is that much less likely to be there.
    """

    group: int
    regions: tuple[Region, ...]
    tracker: AnyAssociator
    targets: Targets
    step_s: float
    p_found: float

    def initial(self) -> GroupState:
        """Make the state before the first scan."""
        return GroupState(self.tracker.initial(), {}, 0, ())

    def step(
        self,
        state: GroupState,
        scan: ReportScan,
        *,
        late: Sequence[ReportScan] = (),
        handed: Sequence[Handover] = (),
    ) -> tuple[GroupState, GroupStep]:
        """Take the next scan, late ones, and hand-overs in any order, repeated or old."""
        tracker, info = self.tracker.step(state.tracker, scan, late)
        found = self.tracker.estimates(tracker)
        names = {i: state.names[i] for i in found.track.tolist() if i in state.names}
        told = newest([*state.pending, *handed])
        pending = tuple(
            predicted(message, scan.t_s, targets=self.targets, step_s=self.step_s)
            for message in told
        )
        names, pending, renamed = _claim(names, pending, found)
        pending = self._missed(pending, told)
        names, given = self._give(names, state.given, found)
        state = GroupState(tracker, names, given, pending)
        report = GroupReport(self.group, _under_names(state, found), renamed)
        return state, GroupStep(report, self._handovers(report.estimates), info)

    def estimates(self, state: GroupState, lag_steps: int = 0) -> Estimates:
        """Tell what is believed of the newest scan, or in hindsight, under the field's names."""
        return _under_names(state, self.tracker.estimates(state.tracker, lag_steps))

    def _give(
        self, names: Mapping[int, Name], given: int, found: Estimates
    ) -> tuple[dict[int, Name], int]:
        """Give a name to every track that is shown and has none; no other group can give it."""
        names = dict(names)
        rows = np.flatnonzero(found.shown)
        firsts = found.first_s[rows].tolist()
        for track, first_s in zip(found.track[rows].tolist(), firsts, strict=True):
            if track not in names:
                names[track] = Name(first_s, given * len(self.regions) + self.group + 1)
                given += 1
        return names, given

    def _missed(
        self, pending: Sequence[Handover], told: Sequence[Handover]
    ) -> tuple[Handover, ...]:
        """Believe less in targets that were not found: r (1 - p) / (1 - r p) for each step.

        Of a message that came late all steps since then count, for no track stands for any of them.
        """
        since = {(m.sender, m.target): m.t_s for m in told}
        missed: list[Handover] = []
        for message in pending:
            age_s = message.t_s - since[message.sender, message.target]
            unseen = (1.0 - self.p_found) ** max(1, round(age_s / self.step_s))
            r = message.existence
            left = r * unseen / (1.0 - r + r * unseen)
            if left > _FORGET:
                missed.append(message._replace(existence=left))
        return tuple(missed)

    def _handovers(self, known: Estimates) -> Mapping[int, tuple[Handover, ...]]:
        """Tell each neighbour of the shown targets that its cell will hold or nearly hold."""
        next_place = known.mean[:, :2] + known.mean[:, 2:] * self.step_s
        near = np.array([region.contains(next_place) & known.shown for region in self.regions]).T
        near[:, self.group] = False
        return {
            int(group): messages_of(self.group, known, np.flatnonzero(near[:, group]).tolist())
            for group in np.flatnonzero(near.any(axis=0))
        }


def _claim(
    names: Mapping[int, Name], pending: tuple[Handover, ...], found: Estimates
) -> tuple[dict[int, Name], tuple[Handover, ...], tuple[tuple[int, int], ...]]:
    """Give expected targets to the tracks that stand for them; the rest stays expected.

    Groups that began tracks of one target tell each other of it; all keep the name of who saw it
    first, or of those who saw it at the same time the smallest one. But two names that one sender
    tells apart are two targets. A name belongs to one track: a former bearer that is elsewhere by
    now loses it.
    """
    names = dict(names)
    named = np.array([track in names for track in found.track.tolist()], bool)
    candidates = selected(found, np.flatnonzero(named | (found.existence >= _CREDIBLE)))
    tracks: list[int] = candidates.track.tolist()
    renamed: list[tuple[int, int]] = []
    waiting: list[Handover] = []
    for sender in sorted({message.sender for message in pending}):
        messages = [message for message in pending if message.sender == sender]
        bearer = {name.target: track for track, name in names.items()}
        places = {name: tracks.index(track) for name, track in bearer.items() if track in tracks}
        pairs = claims(messages, candidates, bearers=places)
        apart = {message.target for message in messages}
        for place, row in pairs:
            told = Name(messages[place].first_s, messages[place].target)
            own = names.get(tracks[row])
            if own is not None and (told >= own or own.target in apart):
                continue
            names.pop(bearer.get(told.target, -1), None)
            if own is not None and told.target not in bearer:
                renamed.append((told.target, own.target))
            names[tracks[row]] = told
        taken = {place for place, _ in pairs}
        waiting.extend(m for i, m in enumerate(messages) if i not in taken)
    return names, tuple(waiting), tuple(renamed)


def _under_names(state: GroupState, found: Estimates) -> Estimates:
    """Put the field's names on own tracks, and add the targets that are expected."""
    known = np.flatnonzero([track in state.names for track in found.track.tolist()])
    ours = selected(found, known)
    own = [state.names[track] for track in ours.track.tolist()]
    bearers = {name.target for name in own}
    expected = {m.target: m for m in state.pending if m.target not in bearers}
    past = [m for m in expected.values() if m.t_s <= found.t_s]
    waiting = estimates_of(past, found.t_s)
    ours = ours._replace(
        track=np.array([name.target for name in own], np.int32),
        first_s=np.array([name.since_s for name in own], float),
    )
    return joined([ours, waiting], found.t_s)
