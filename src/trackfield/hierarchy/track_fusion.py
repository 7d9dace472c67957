"""Track fusion at the base: what the groups believe, united into tracks of the whole field."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.association.contract import Estimates
from trackfield.association.model import Targets
from trackfield.hierarchy.cells import Cells
from trackfield.hierarchy.estimates import carried, joined, selected
from trackfield.hierarchy.group import GroupReport
from trackfield.hierarchy.handover import (
    GATE,
    distances2,
    matched,
)
from trackfield.raster import Region

Pair = tuple[int, int]


class FusionState(NamedTuple):
    """What the base knows: names that mean the same target, pairs that may, and the last reports.

    `same` maps a name to the one that stands for it, `since` names to when they were shown first;
    `suspected` counts for how many steps two names of two groups have looked like one target.
    """

    same: Mapping[int, int]
    since: Mapping[int, float]
    suspected: Mapping[Pair, int]
    last: Mapping[int, Estimates]


class TrackFusion(NamedTuple):
    """The base: unites the groups' tracks, one a target, and corrects what groups named twice.

    A target is told by the group that knows its place best. A group speaks of its cell and, where
    the owner of a place has nothing to say, of the rest of its region (of `regions`). Tracks of two
    groups that stay within the gate of each other for `confirm_steps` are one target. A group that
    is silent is believed for `patience_steps` more, its tracks carried on.
    """

    cells: Cells
    targets: Targets
    step_s: float
    regions: tuple[Region, ...]
    confirm_steps: int = 2
    patience_steps: int = 3

    def initial(self) -> FusionState:
        """Make the state before the first report."""
        return FusionState({}, {}, {}, {})

    def step(
        self, state: FusionState, t_s: float, *, reports: Sequence[GroupReport]
    ) -> tuple[FusionState, Estimates]:
        """Unite what groups report of time `t_s`; older and repeated reports change nothing."""
        same, last = dict(state.same), dict(state.last)
        for report in reports:
            if report.group in last and report.estimates.t_s <= last[report.group].t_s:
                continue
            last[report.group] = report.estimates
            for identity, former in report.renamed:
                _unite(same, state.since, identity, former)
        oldest = t_s - (self.patience_steps + 0.5) * self.step_s
        now = {
            group: carried(known, t_s, targets=self.targets, step_s=self.step_s)
            for group, known in last.items()
            if known.t_s >= oldest
        }
        _part(same, now)
        suspected = self._suspect(same, state.suspected, now)
        for pair, steps in suspected.items():
            if steps >= self.confirm_steps:
                _unite(same, state.since, *pair)
        alive = {same.get(int(i), int(i)) for known in last.values() for i in known.track}
        same = {name: head for name, head in same.items() if head in alive}
        since = {name: t for name, t in state.since.items() if name in alive}
        united = self.unite(FusionState(same, since, suspected, last), now, t_s=t_s)
        for name in united.track[united.shown].tolist():
            since.setdefault(name, t_s)
        return FusionState(same, since, suspected, last), united

    def unite(self, state: FusionState, known: Mapping[int, Estimates], *, t_s: float) -> Estimates:
        """Make one track a target of what groups know of time `t_s`."""
        speakers = sorted(known)
        found = joined([known[group] for group in speakers], t_s)
        sizes = [len(known[group].track) for group in speakers]
        group = np.repeat(np.array(speakers, np.intp), sizes)
        name = np.array([state.same.get(int(i), int(i)) for i in found.track], np.int32)
        owner = self.cells.owner(found.mean[:, :2])
        heard = np.array([region.contains(found.mean[:, :2]) for region in self.regions])
        own = owner == group
        # Another group than the owner counts where the owner is silent or has no such target.
        told = {(int(g), int(n)) for g, n in zip(group, name, strict=True)}
        other = np.array(
            [
                int(o) not in known or (heard[group[i], i] and (int(o), int(name[i])) not in told)
                for i, o in enumerate(owner)
            ],
            bool,
        )
        usable = (own | other) & found.shown
        spread = found.covariance[:, 0, 0] + found.covariance[:, 1, 1]
        kept: dict[int, int] = {}
        for row in np.lexsort((spread, ~usable)):
            kept.setdefault(int(name[row]), int(row))
        chosen = np.array(sorted(kept.values(), key=lambda row: int(name[row])), int)
        visible = usable & self._alone(found, group, usable=usable, own=own)
        first = [found.first_s[name == n].min() for n in name[chosen]]
        return selected(found, chosen)._replace(
            track=name[chosen], first_s=np.array(first, float), shown=visible[chosen]
        )

    def _alone(
        self,
        found: Estimates,
        group: NDArray[np.intp],
        *,
        usable: NDArray[np.bool_],
        own: NDArray[np.bool_],
    ) -> NDArray[np.bool_]:
        """Tell which rows are no second sight of a target that the owner of its place shows.

        Before two names are known to be one target, the owner's row stands for it.
        """
        alone = np.ones(len(group), bool)
        for row in np.flatnonzero(usable & ~own):
            rivals = np.flatnonzero(usable & own & (group != group[row]))
            if rivals.size and self._distances(found, np.array([row]), rivals).min() <= GATE:
                alone[row] = False
        return alone

    def _suspect(
        self,
        same: Mapping[int, int],
        before: Mapping[Pair, int],
        now: Mapping[int, Estimates],
    ) -> dict[Pair, int]:
        """Count on pairs of names, of two groups, that look like one target in this step."""
        suspected: dict[Pair, int] = {}
        for a, b in combinations(sorted(now), 2):
            ours, theirs = self._overlap(now[a], b), self._overlap(now[b], a)
            names_a = [same.get(int(i), int(i)) for i in now[a].track]
            names_b = [same.get(int(i), int(i)) for i in now[b].track]
            shown_a = {names_a[i] for i in np.flatnonzero(now[a].shown)}
            shown_b = {names_b[j] for j in np.flatnonzero(now[b].shown)}
            ours = [i for i in ours if names_a[i] not in shown_b]
            theirs = [j for j in theirs if names_b[j] not in shown_a]
            if not (ours and theirs):
                continue
            costs = distances2(
                now[a].mean[ours],
                now[a].covariance[ours],
                means=now[b].mean[theirs],
                covariances=now[b].covariance[theirs],
            )
            for i, j in matched(costs):
                one, other = names_a[ours[i]], names_b[theirs[j]]
                first = float(now[a].first_s[ours[i]]), float(now[b].first_s[theirs[j]])
                older = (first[0], one) <= (first[1], other)
                pair = (one, other) if older else (other, one)
                suspected[pair] = before.get(pair, 0) + 1
        return suspected

    def _overlap(self, known: Estimates, group: int) -> Sequence[int]:
        """Rows that are shown and in the region of `group`."""
        return np.flatnonzero(
            self.regions[group].contains(known.mean[:, :2]) & known.shown
        ).tolist()

    def _distances(
        self, found: Estimates, rows: NDArray[np.intp], others: NDArray[np.intp]
    ) -> NDArray[np.float64]:
        return distances2(
            found.mean[rows],
            found.covariance[rows],
            means=found.mean[others],
            covariances=found.covariance[others],
        )


def _unite(same: dict[int, int], since: Mapping[int, float], one: int, other: int) -> None:
    """Let one name stand for both, and for all that they stood for.

    What was shown first keeps its name, so that who looks on sees no change; else `one` does.
    """
    head, tail = same.get(one, one), same.get(other, other)
    if head == tail:
        return
    if since.get(tail, np.inf) < since.get(head, np.inf):
        head, tail = tail, head
    for name, stands in list(same.items()):
        if stands == tail:
            same[name] = head
    same[tail] = head


def _part(same: dict[int, int], now: Mapping[int, Estimates]) -> None:
    """Take back that two names are one target where a group shows both."""
    for known in now.values():
        shown: set[int] = set(known.track[known.shown].tolist())
        for name in shown & same.keys():
            if same[name] in shown:
                del same[name]
