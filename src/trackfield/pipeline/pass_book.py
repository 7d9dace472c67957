"""The passes of one name: messages in, passes with identities over time out.

Readings that name a target are of that one, and one pass of it is under way at a time. Readings
that name none are of any number of targets: their messages are grouped.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from trackfield.localization.pass_evidence import evidence, misfits
from trackfield.localization.pass_fusion import PassVerdict
from trackfield.localization.pass_groups import JOINS, group
from trackfield.localization.pass_raw import RawPass
from trackfield.localization.pass_stream import SensorMessage, together
from trackfield.pipeline.live_passes import Key, LivePass, PassRow, PassRules, live_pass
from trackfield.pipeline.pass_beliefs import UNKNOWN, PassBelief, by_messages, by_samples
from trackfield.sensing.amplitude import AmplitudeModel
from trackfield.sensing.profile import Profile
from trackfield.types import Status

MOST_MESSAGES = 300  # that are remembered; the oldest are forgotten
MOST_SAMPLES = 8192  # of one sensor that are remembered
MOST_OVER = 100  # passes that are over and still told
_SLACK_S = 1e-6
_ANOTHER = 100.0  # deviance of a message that is of another pass of the same target
_AS_LOUD = 0.25  # of a message's amplitude: what another pass should have added to its samples
_CLEAR = 12.0  # deviance of a message that may join a pass without another look at all


class Ears(NamedTuple):
    """All samples of one sensor, in order of time."""

    x_m: float
    y_m: float
    model: AmplitudeModel
    t_s: list[float]
    value: list[float]

    def add(self, t_s: float, value: float) -> None:
        """Remember a sample."""
        self.t_s.append(t_s)
        self.value.append(value)
        if len(self.t_s) > MOST_SAMPLES:
            del self.t_s[: MOST_SAMPLES // 2], self.value[: MOST_SAMPLES // 2]


@dataclass(slots=True, eq=False)
class PassBook:
    """Messages and passes of one name; `named` tells that there is one target."""

    rules: PassRules
    named: bool
    messages: dict[Key, SensorMessage] = field(default_factory=dict[Key, SensorMessage])
    live: list[LivePass] = field(default_factory=list[LivePass])
    over: list[LivePass] = field(default_factory=list[LivePass])  # the last that ended
    ears: dict[int, Ears] = field(default_factory=dict[int, Ears])
    tracks: int = 0  # numbers given
    started: int = 0
    ended: int = 0
    now_s: float = -math.inf

    def unexplained(self) -> tuple[Key, ...]:
        """Messages that heard something and are of no pass."""
        taken = frozenset[Key]().union(*(one.keys for one in self.live))
        heard = {key for key, message in self.messages.items() if message.profile.a_max > 0.0}
        return tuple(sorted(heard - taken))

    def told(self, key: Key, message: SensorMessage, now_s: float) -> list[PassRow]:
        """Take a message, new or in the place of an earlier one; rows of what is over by it.

        What else it changes is told when time goes on, with all that is said at this time.
        """
        rows = self.advance(now_s)
        if self.ears and any(key in one.keys for one in self.over):
            return rows  # a better word about a pass that is over
        if self.named and self._returns(message):
            for one in list(self.live):
                rows += self._end(one, self.now_s)
            self.messages.clear()
        self.messages[key] = message
        before = list(self.live)
        changed = self._joined(key) or self._regrouped()
        for one in before:
            if one not in self.live and one.confirmed:
                rows += one.at(self.now_s, Status.ENDED)
        for one in sorted(changed, key=lambda one: min(one.keys)):
            self._believed(one)
        return rows

    def settled(self) -> list[PassRow]:
        """Rows of what changed now, at the time of the book: no more of this time is to come."""
        passes = sorted(self.live, key=lambda one: min(one.keys))
        return [row for one in passes for row in one.rows(self.now_s, self.rules)]

    def advance(self, now_s: float) -> list[PassRow]:
        """Let time pass: rows where passes go on, and the ends of those that are over."""
        if now_s <= self.now_s:
            return []
        rows = self.settled()
        self.now_s = now_s
        for one in list(self.live):
            rows += one.coasting(now_s, self.rules)
            if one.is_over(now_s, self.rules):
                rows += self._end(one, now_s)
        return rows

    def finish(self) -> list[PassRow]:
        """Look at everything once more; the last rows, and those that wait for their lag."""
        rows: list[PassRow] = []
        if self.messages:
            self._regrouped()
        for one in self.live:
            one.row_s = -math.inf  # a last row, however soon after the one before
            self._believed(one)
            rows += one.rows(self.now_s, self.rules)
            if self.rules.lag_s > 0.0:
                rows += one.past(self.now_s, self.rules, last=True)
        return rows

    def _joined(self, key: Key) -> list[LivePass]:
        """Give a message to the one pass that clearly expects it; none if all is to be looked at.

        What takes the place of an earlier message stays where that was.
        """
        holders = [one for one in self.live if key in one.keys]
        if holders or self.named:
            return holders
        deviance = [_misfit(one.belief, self.messages[key]) for one in self.live]
        order = sorted(range(len(deviance)), key=deviance.__getitem__)
        if not order or deviance[order[0]] > _CLEAR:
            return []
        best = self.live[order[0]]
        rival = deviance[order[1]] if len(order) > 1 else math.inf
        mine = _record(self.messages[key])
        if rival < JOINS or any(_record(self.messages[one]) == mine for one in best.keys):
            return []
        best.keys |= {key}
        return [best]

    def _returns(self, message: SensorMessage) -> bool:
        """Tell whether the one target passes once more: what is said is not of the pass known."""
        for one in self.live:
            later = float(message.profile.t_max_s) > max(
                float(self.messages[key].profile.t_max_s) for key in one.keys
            )
            sure = one.belief.verdict == PassVerdict.GOOD
            if later and sure and _misfit(one.belief, message) > _ANOTHER:
                return True
        return False

    def _regrouped(self) -> list[LivePass]:
        """Tell again which messages are of one pass; what has changed by it.

        A pass goes on as the one that it shares most messages with.
        """
        by_age = sorted(self.messages, key=lambda key: self.messages[key].first_s)
        for key in by_age[: max(len(by_age) - MOST_MESSAGES, 0)]:
            del self.messages[key]
        old, self.live = self.live, list[LivePass]()
        changed: list[LivePass] = []
        for part in self._parts():
            one = max(old, key=lambda one: len(one.keys & part), default=None)
            if one is None or not one.keys & part:
                one = LivePass(part, UNKNOWN, math.inf, math.inf, self.now_s)
            else:
                old.remove(one)
            if one.keys != part or not one.belief.modes:
                changed.append(one)
            one.keys = part
            self.live.append(one)
        self.ended += sum(1 for one in old if one.tracks)
        return changed

    def _parts(self) -> list[frozenset[Key]]:
        keys = sorted(self.messages)
        if self.named:
            return [frozenset(keys)]
        told = [self.messages[key] for key in keys]
        start_s = float(np.median([float(one.profile.t_max_s) for one in told]))
        records = sorted({_record(one) for one in told})
        record = np.array([records.index(_record(one)) for one in told], np.int32)
        found = group(together(told, start_s=start_s), record)
        return [frozenset(keys[int(row)] for row in one.messages) for one in found.groups]

    def _believed(self, one: LivePass) -> None:
        """Find what is believed of a pass."""
        told = [self.messages[key] for key in sorted(one.keys)]
        belief = by_messages(told, doubtful=self._doubtful(one, told))
        one.begin_s = min(message.first_s for message in told)
        one.end_s = max(_end_s(message) for message in told)
        if self.ears:
            whole = by_samples(belief, self._raw(told, to_the_end=True))
            # Later samples may be of what came next.
            belief = whole if whole.by_samples else by_samples(belief, self._raw(told))
        self.started += bool(belief.modes and not one.tracks)
        self.tracks = one.believe(belief, self.now_s, tracks=self.tracks, rules=self.rules)

    def _doubtful(self, one: LivePass, told: list[SensorMessage]) -> list[SensorMessage]:
        """Messages that may be of something else; where there are samples, those tell it better."""
        return [] if self.ears else [m for m in told if self._is_doubtful(one, m)]

    def _is_doubtful(self, one: LivePass, message: SensorMessage) -> bool:
        """Tell whether a message of a pass may be all that was left of another one.

        So it is where another pass that is sure would have been about as loud at the time it tells
        of, and nothing else is said of that in this record: a source that stopped being heard or
        turned off, of which the sensor made what it could.
        """
        t_s, a_max = float(message.profile.t_max_s), float(message.profile.a_max)
        for other in self.live:
            if other is one or other.belief.verdict != PassVerdict.GOOD:
                continue
            if any(_record(self.messages[key]) == _record(message) for key in other.keys):
                continue
            x, y = other.belief.places(t_s)[0].tolist()
            r = max(math.hypot(x - message.x_m, y - message.y_m), 1e-9)
            power = float(other.belief.modes[0].theta[0])
            if math.sqrt(power) * r**-message.model.exponent > _AS_LOUD * a_max:
                return True
        return False

    def _raw(self, told: list[SensorMessage], *, to_the_end: bool = False) -> RawPass:
        """All samples of a pass: of each sensor those of its record, or all since that began.

        Of sensors without a message those count since the last of the records began.
        """
        records = {m.sensor: (m.first_s, _end_s(m)) for m in reversed(told)}
        others = (max(m.first_s for m in told), max(_end_s(m) for m in told))
        sensor, t_s, value = list[int](), list[float](), list[float]()
        ears = [(number, self.ears[number]) for number in sorted(self.ears)]
        for place, (number, own) in enumerate(ears):
            begin_s, end_s = records.get(number, others)
            first = bisect_left(own.t_s, begin_s - _SLACK_S)
            past = len(own.t_s) if to_the_end else bisect_right(own.t_s, end_s + _SLACK_S)
            t_s += own.t_s[first:past]
            value += own.value[first:past]
            sensor += [place] * (past - first)
        return RawPass(
            np.array([(own.x_m, own.y_m) for _, own in ears]).reshape(-1, 2),
            tuple(own.model for _, own in ears),
            np.array(sensor, np.int32),
            np.array(t_s),
            np.array(value),
        )

    def _end(self, one: LivePass, now_s: float) -> list[PassRow]:
        """End a pass and forget its messages."""
        rows = one.past(now_s, self.rules) if self.rules.lag_s > 0.0 else []
        rows += one.at(now_s, Status.ENDED) if one.confirmed else []
        self.live.remove(one)
        self.ended += bool(one.tracks)
        self.over = [*self.over, one][-MOST_OVER:] if one.confirmed else self.over
        for key in one.keys & self.messages.keys():
            del self.messages[key]
        return rows

    def plain(self) -> dict[str, Any]:
        """Plain values that `restore` takes back, exactly."""
        return {
            "messages": [
                [*key, list(m.profile), m.first_s, m.step_s, m.samples]
                for key, m in self.messages.items()
            ],
            "live": [one.plain() for one in self.live],
            "over": [one.plain() for one in self.over],
            "ears": [[number, ears.t_s, ears.value] for number, ears in self.ears.items()],
            "numbers": [self.tracks, self.started, self.ended, self.now_s],
        }

    def restore(self, plain: dict[str, Any], sensors: dict[int, Ears]) -> None:
        """Take up the book where `plain` left it; `sensors` are the site's, without samples."""
        for sensor, number, profile, first_s, step_s, samples in plain["messages"]:
            x_m, y_m, model = sensors[sensor][:3]
            self.messages[sensor, number] = SensorMessage(
                sensor, x_m, y_m, model, Profile(*profile), first_s, step_s, samples
            )
        self.live = [live_pass(one) for one in plain["live"]]
        self.over = [live_pass(one) for one in plain["over"]]
        for number, t_s, value in plain["ears"]:
            self.ears[number] = sensors[number]._replace(t_s=t_s, value=value)
        self.tracks, self.started, self.ended, self.now_s = plain["numbers"]


def _end_s(message: SensorMessage) -> float:
    return message.first_s + message.step_s * (message.samples - 1)


def _record(message: SensorMessage) -> tuple[int, float]:
    """Which record a message is of: whose, and when it began."""
    return message.sensor, message.first_s


def _misfit(belief: PassBelief, message: SensorMessage) -> float:
    """Squared misfit of a message under the likeliest trajectory."""
    if not belief.modes:
        return math.inf
    given = evidence(together([message], start_s=belief.start_s))
    return float(misfits(given, belief.modes[0].theta, exponent=message.model.exponent)[0])
