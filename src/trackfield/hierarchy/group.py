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


class GroupState(NamedTuple):
    """What a group knows: its tracker's state, which tracks are whose, and who is expected.

    `names` maps the tracker's own track numbers to identities in the whole field; `pending` holds
    targets that were handed over and that no own track stands for yet.
    """

    tracker: Any
    names: Mapping[int, int]
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
    is lost does no harm.
    """

    group: int
    regions: tuple[Region, ...]
    tracker: AnyAssociator
    targets: Targets
    step_s: float

    def initial(self) -> GroupState:
        """Make the state before the first scan."""
        return GroupState(self.tracker.initial(), {}, ())

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
        names = {int(i): state.names[int(i)] for i in found.track if int(i) in state.names}
        pending = self._expected(state.pending, handed, scan.t_s, set(names.values()))
        names, pending, renamed = self._claim(names, pending, found)
        unnamed = [int(i) for i in found.track if int(i) not in names]
        names = {**names, **{i: self._own(i) for i in unnamed}}
        state = GroupState(tracker, names, pending)
        report = GroupReport(self.group, self._named(state, found), renamed)
        return state, GroupStep(report, self._handovers(report.estimates), info)

    def estimates(self, state: GroupState, lag_steps: int = 0) -> Estimates:
        """Tell what is believed of the newest scan, or in hindsight, under the field's names."""
        return self._named(state, self.tracker.estimates(state.tracker, lag_steps))

    def _own(self, track: int) -> int:
        """Identity of a track of this group that no other group has given, from 1."""
        return (track - 1) * len(self.regions) + self.group + 1

    def _expected(
        self, pending: Sequence[Handover], handed: Sequence[Handover], t_s: float, known: set[int]
    ) -> tuple[Handover, ...]:
        """Carry on what is expected; drop what is tracked already or was not found for long."""
        carried = (
            predicted(message, t_s, targets=self.targets, step_s=self.step_s)
            for message in newest([*pending, *handed])
            if message.target not in known
        )
        return tuple(message for message in carried if message.existence > _FORGET)

    def _claim(
        self, names: dict[int, int], pending: tuple[Handover, ...], found: Estimates
    ) -> tuple[dict[int, int], tuple[Handover, ...], tuple[tuple[int, int], ...]]:
        """Give expected targets to the tracks that stand for them.

        Neighbours that began tracks of one target at the same time tell each other of it; both
        keep the name of the older track, or of two as old the smaller one.
        """
        pairs = claims(pending, found)
        renamed: list[tuple[int, int]] = []
        for place, row in pairs:
            told, track = pending[place], int(found.track[row])
            own = (float(found.first_s[row]), names.get(track, self._own(track)))
            if (told.first_s, told.target) < own:
                if track in names:
                    renamed.append((told.target, names[track]))
                names[track] = told.target
        taken = {place for place, _ in pairs}
        return names, tuple(m for i, m in enumerate(pending) if i not in taken), tuple(renamed)

    def _named(self, state: GroupState, found: Estimates) -> Estimates:
        """Put the field's names on own tracks, and add the targets that are expected."""
        known = np.array([int(i) in state.names for i in found.track], bool)
        own = [state.names[int(i)] for i in found.track[known]]
        waiting = estimates_of([m for m in state.pending if m.t_s <= found.t_s], found.t_s)
        track = np.array([*own, *waiting.track], np.int32)
        ours = selected(found, np.flatnonzero(known))
        return joined([ours, waiting], found.t_s)._replace(track=track)

    def _handovers(self, known: Estimates) -> Mapping[int, tuple[Handover, ...]]:
        """Tell each neighbour of the shown targets that its cell will hold or nearly hold."""
        next_place = known.mean[:, :2] + known.mean[:, 2:] * self.step_s
        near = np.array([region.contains(next_place) & known.shown for region in self.regions]).T
        near[:, self.group] = False
        return {
            int(group): messages_of(known, np.flatnonzero(near[:, group]).tolist())
            for group in np.flatnonzero(near.any(axis=0))
        }
