"""The whole hierarchy as one tracker: groups side by side, hand-overs between them, the base."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackfield.association.contract import (
    AnyAssociator,
    Estimates,
    Explanation,
    Info,
    ReportScan,
)
from trackfield.association.model import Scene
from trackfield.hierarchy.archive import (
    estimates_from,
    messages_from,
    packed,
    plain_estimates,
    plain_messages,
    unpacked,
)
from trackfield.hierarchy.cells import Cells
from trackfield.hierarchy.group import GroupState, Name, TrackingGroup
from trackfield.hierarchy.handover import Handover
from trackfield.hierarchy.track_fusion import FusionState, TrackFusion
from trackfield.raster import Raster
from trackfield.types import Matrix

_USUAL = 0.5  # detection probability where nothing is told of it


class FieldState(NamedTuple):
    """States of all groups and of the base, hand-overs under way, and what was shown last."""

    groups: tuple[GroupState, ...]
    base: FusionState
    under_way: tuple[tuple[Handover, ...], ...]
    shown: Estimates


@dataclass(frozen=True, slots=True, eq=False)
class TrackedField:
    """Tracking groups around `centres` and their base, as one `Associator` of the whole field.

    A report goes to every group in whose region (the box around its cell and a margin) it lies:
    with what they hear, groups agree at their borders, and the base's tracks are those of one
    central tracker. A hand-over arrives before the next step.
    """

    groups: tuple[TrackingGroup, ...]
    base: TrackFusion

    def initial(self) -> FieldState:
        """Make the state before the first scan."""
        n = len(self.groups)
        return FieldState(
            tuple(group.initial() for group in self.groups),
            self.base.initial(),
            ((),) * n,
            self.base.unite(self.base.initial(), {}, t_s=-np.inf),
        )

    def step(
        self, state: FieldState, scan: ReportScan, late: Sequence[ReportScan] = ()
    ) -> tuple[FieldState, Info]:
        """Take the next scan, and reports that belong to earlier ones."""
        scans = [self._split(one) for one in (*late, scan)]
        stepped = [
            group.step(
                known,
                scans[-1][i],
                late=[parts[i] for parts in scans[:-1] if parts[i].number.size],
                handed=state.under_way[i],
            )
            for i, (group, known) in enumerate(zip(self.groups, state.groups, strict=True))
        ]
        sent: list[list[Handover]] = [[] for _ in self.groups]
        for _, outcome in stepped:
            for neighbour, messages in outcome.handovers.items():
                sent[neighbour].extend(messages)
        reports = [outcome.report for _, outcome in stepped]
        base, shown = self.base.step(state.base, scan.t_s, reports=reports)
        groups = tuple(known for known, _ in stepped)
        info = _summed([outcome.info for _, outcome in stepped], handed=sum(map(len, sent)))
        return FieldState(groups, base, tuple(map(tuple, sent)), shown), info

    def estimates(self, state: FieldState, lag_steps: int = 0) -> Estimates:
        """Tell what is believed of the newest scan, or in hindsight of `lag_steps` before it."""
        if not lag_steps:
            return state.shown
        pairs = zip(self.groups, state.groups, strict=True)
        known = [group.estimates(own, lag_steps) for group, own in pairs]
        t_s = max(one.t_s for one in known)
        return self.base.unite(state.base, dict(enumerate(known)), t_s=t_s)

    def explain(self, state: FieldState, track: int) -> Explanation | None:
        """Say why a track is there: what the group says that is surest of it."""
        found: list[Explanation] = []
        for group, known in zip(self.groups, state.groups, strict=True):
            for own, name in known.names.items():
                if state.base.same.get(name.target, name.target) == track:
                    said = group.tracker.explain(known.tracker, own)
                    found.extend([] if said is None else [said._replace(track=track)])
        return max(found, key=lambda one: one.existence, default=None)

    def encode(self, state: FieldState) -> bytes:
        """Write a state as bytes, versioned, not pickle."""
        pairs = zip(self.groups, state.groups, strict=True)
        trackers = [group.tracker.encode(known.tracker) for group, known in pairs]
        head = {
            "groups": [
                [[[track, *name] for track, name in known.names.items()], known.given]
                for known in state.groups
            ],
            "pending": [plain_messages(known.pending) for known in state.groups],
            "under_way": [plain_messages(messages) for messages in state.under_way],
            "same": sorted(state.base.same.items()),
            "since": list(state.base.since.items()),
            "suspected": [[*pair, n] for pair, n in state.base.suspected.items()],
            "last": [[g, plain_estimates(known)] for g, known in state.base.last.items()],
            "shown": plain_estimates(state.shown),
        }
        return packed(head, trackers)

    def decode(self, data: bytes) -> FieldState:
        """Read a state that `encode` wrote; `StateError` for other bytes."""
        head, trackers = unpacked(data, parts=len(self.groups))
        groups = [
            GroupState(
                group.tracker.decode(part),
                {track: Name(since_s, target) for track, since_s, target in names},
                given,
                messages_from(pending),
            )
            for group, part, (names, given), pending in zip(
                self.groups, trackers, head["groups"], head["pending"], strict=True
            )
        ]
        base = FusionState(
            dict(head["same"]),
            dict(head["since"]),
            {(a, b): n for a, b, n in head["suspected"]},
            {group: estimates_from(plain) for group, plain in head["last"]},
        )
        under_way = tuple(messages_from(plain) for plain in head["under_way"])
        return FieldState(tuple(groups), base, under_way, estimates_from(head["shown"]))

    def _split(self, scan: ReportScan) -> list[ReportScan]:
        """Give each group the reports of its region."""
        heard = [region.contains(scan.position) for region in self.base.regions]
        return [
            ReportScan(scan.t_s, scan.position[mine], scan.covariance[mine], scan.number[mine])
            for mine in heard
        ]


def tracked_field(
    scene: Scene,
    centres: Matrix,
    *,
    tracker: Callable[[Scene], AnyAssociator],
    margin_m: float | None = None,
) -> TrackedField:
    """Make a hierarchy of groups around `centres` (g, 2) [m]; `tracker` makes each group's own.

    `margin_m` is how far groups hear beyond their cells: by default what a target covers in eight
    steps at twice the usual speed, and three deviations of a report; 0: square cells share nothing
    but hand-overs, as in Oh IV.B.
    """
    cells, reporting = Cells(centres), scene.reporting
    if margin_m is None:
        reach = 16.0 * scene.targets.velocity_sigma_m_s * reporting.step_s
        margin_m = reach + 3.0 * (reporting.sigma_m or 0.0)
    seen = (_USUAL,) if reporting.p_detection is None else reporting.p_detection
    p_found = seen[0].mean() if isinstance(seen[0], Raster) else seen[0]
    regions = tuple(
        cells.region(group, reporting.region, margin_m=margin_m) for group in range(len(cells))
    )
    groups = tuple(
        TrackingGroup(
            group,
            regions,
            tracker(cells.scene(group, scene, margin_m=margin_m)),
            scene.targets,
            reporting.step_s,
            p_found,
        )
        for group in range(len(cells))
    )
    base = TrackFusion(cells, scene.targets, reporting.step_s, regions)
    return TrackedField(groups, base)


def _summed(infos: Sequence[Info], *, handed: int) -> Info:
    """Add up what groups counted; what they learned is the mean."""
    counts: dict[str, int] = {"handed_over": handed}
    learned: dict[str, list[float]] = {}
    for info in infos:
        for name, count in info.counts.items():
            counts[name] = counts.get(name, 0) + count
        for name, value in info.learned.items():
            learned.setdefault(name, []).append(value)
    means = {name: float(np.mean(values)) for name, values in learned.items()}
    return Info(counts, means, sum(info.work for info in infos))
