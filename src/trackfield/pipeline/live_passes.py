"""One pass over time: what is believed of it, its tracks, and which rows are due."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from trackfield.filtering.scans import Shown
from trackfield.pipeline.pass_beliefs import PassBelief, packed, unpacked
from trackfield.types import Matrix, Status

Key = tuple[int, int]  # a sensor, and which of its passes
_FAR = 4.0  # field radii from the middle of the sensors at which a pass is over
_SLACK_S = 1e-9
_ROWS_A_LAG = 20  # or to the length of the records, where that is shorter


class PassRules(NamedTuple):
    """When a pass that says no more ends, which rows are asked for [s], and where sensors stand.

    `patience_s` is how much later than the target somebody may speak of it.
    """

    drop_s: float
    lag_s: float
    every_s: float
    middle: tuple[float, float]
    radius_m: float
    patience_s: float = 0.0


class PassRow(NamedTuple):
    """A row of a track, numbered within its book from 1."""

    track: int
    shown: Shown


@dataclass(slots=True, eq=False)
class LivePass:
    """One pass: its messages by `keys`, what is believed, the tracks of its trajectories in order.

    `begin_s`, `end_s` are where its records begin and end, `heard_s` when it last changed, `news`
    that this is still to be told; `row_s` and `told_s` are times of its last row, as due and as
    told, which a lag sets apart; `confirmed` that one trajectory was sure at some time.
    """

    keys: frozenset[Key]
    belief: PassBelief
    begin_s: float
    end_s: float
    heard_s: float
    tracks: list[int] = field(default_factory=list[int])
    row_s: float = -math.inf
    told_s: float = -math.inf
    confirmed: bool = False
    news: bool = False

    def believe(self, belief: PassBelief, now_s: float, *, tracks: int, rules: PassRules) -> int:
        """Take a new belief; how many tracks there are in all, `tracks` before."""
        before = self.belief.places(now_s) if self.tracks else np.empty((0, 2))
        self.belief, self.heard_s, self.news = belief, now_s, True
        self.tracks, count = _matched(
            self.tracks, before, belief.places(now_s), tracks, max(rules.radius_m, 1.0)
        )
        return count

    def rows(self, now_s: float, rules: PassRules) -> list[PassRow]:
        """Rows of a pass if it has changed and they are due; nothing changes it more by `now_s`."""
        if not self.news:
            return []
        self.news = False
        if rules.lag_s > 0.0:
            return self.past(now_s - rules.lag_s, rules)
        if now_s < self.row_s + rules.every_s - _SLACK_S:
            return []
        self.row_s = now_s
        return self.at(now_s, Status.CONFIRMED)

    def coasting(self, now_s: float, rules: PassRules) -> list[PassRow]:
        """Rows every so often before `now_s`, where nothing changed."""
        if rules.lag_s > 0.0:
            return self.past(now_s - rules.lag_s, rules)
        rows: list[PassRow] = []
        if rules.every_s <= 0.0 or not math.isfinite(self.row_s):
            return rows
        while self.row_s + rules.every_s < now_s - _SLACK_S:
            if self.is_over(self.row_s + rules.every_s, rules):
                break
            self.row_s += rules.every_s
            rows += self.at(self.row_s, Status.COASTING)
        return rows

    def past(self, until_s: float, rules: PassRules, *, last: bool = False) -> list[PassRow]:
        """Rows up to `until_s`, known what is known now, from the beginning of the records on.

        They are `every_s` apart, or a twentieth of the lag, of the records if those are shorter;
        the `last` one is at `until_s`.
        """
        rows: list[PassRow] = []
        if not self.belief.modes:
            return rows
        step_s = rules.every_s or min(rules.lag_s, self.end_s - self.begin_s) / _ROWS_A_LAG
        due_s = max(self.begin_s, self.told_s + step_s)
        past_s = until_s - _SLACK_S if last else until_s + _SLACK_S
        while due_s <= past_s:
            rows += self.at(due_s, Status.CONFIRMED)
            due_s += step_s
        return rows + self.at(until_s, Status.CONFIRMED) if last else rows

    def at(self, t_s: float, status: Status) -> list[PassRow]:
        """Rows of a time after the last told one: `status` if one trajectory is sure."""
        if t_s <= self.told_s or t_s < self.begin_s or not self.belief.modes:
            return []
        self.told_s = t_s
        shown = self.belief.shown(t_s)
        if shown[0].status != Status.TENTATIVE:
            self.confirmed = True
            shown = [shown[0]._replace(status=status)]
        return [PassRow(track, row) for track, row in zip(self.tracks, shown, strict=False)]

    def is_over(self, now_s: float, rules: PassRules) -> bool:
        """Tell whether nothing more is to be heard of it: long silent, or far away."""
        if now_s - self.heard_s > rules.drop_s:
            return True
        then_s = now_s - rules.patience_s
        if not self.belief.modes or then_s <= self.belief.start_s:
            return False
        x, y = self.belief.places(then_s)[0].tolist()
        apart = math.hypot(x - rules.middle[0], y - rules.middle[1])
        return apart > _FAR * max(rules.radius_m, 1.0)

    def plain(self) -> list[Any]:
        """Plain values that `live_pass` takes back, exactly."""
        times = [self.begin_s, self.end_s, self.heard_s, self.row_s, self.told_s]
        said = [self.confirmed, self.news]
        return [sorted(self.keys), packed(self.belief), times, self.tracks, said]


def live_pass(plain: list[Any]) -> LivePass:
    """Return the pass that was made plain."""
    keys, belief, (begin_s, end_s, heard_s, row_s, told_s), tracks, said = plain
    own = frozenset((int(sensor), int(number)) for sensor, number in keys)
    confirmed, news = said
    known = LivePass(own, unpacked(belief), begin_s, end_s, heard_s, tracks, row_s, told_s)
    known.confirmed, known.news = confirmed, news
    return known


def _matched(
    known: Sequence[int], before: Matrix, places: Matrix, count: int, reach_m: float
) -> tuple[list[int], int]:
    """Tracks of trajectories at `places`: each goes on as the nearest known one that is left.

    Those that none is within `reach_m` of get numbers after `count`, which is given back grown.
    """
    left, out = list(range(min(len(known), len(before)))), list[int]()
    for place in places:
        apart = [float(np.hypot(*(place - before[k]))) for k in left]
        best = int(np.argmin(apart)) if apart else -1
        if best >= 0 and apart[best] <= reach_m:
            out.append(known[left.pop(best)])
        else:
            count += 1
            out.append(count)
    return out, count
