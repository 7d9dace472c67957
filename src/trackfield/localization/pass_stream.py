"""Messages of one pass one by one, in any order, with an estimate after each.

What is kept is a value: the messages by sensor, and the sum of their linear equations. The
estimate is that of `pass_fusion.fuse` on what is there, so that the last one is the batch estimate
whatever the order in which the messages came.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackfield.localization import pass_lifted
from trackfield.localization.pass_fusion import Passes, PassSettings, fuse
from trackfield.localization.pass_lifted import LiftedPass, LiftedSum
from trackfield.localization.pass_messages import PassMessages, PassRecords, fishers
from trackfield.sensing.amplitude import AmplitudeModel
from trackfield.sensing.profile import Profile
from trackfield.types import Vector


class SensorMessage(NamedTuple):
    """One sensor's message about one pass: who said it, what, and of which record.

    `sensor` is its number, `x_m`, `y_m` where it stands; `profile` what it said (see `Profile`),
    made of `samples` amplitudes from `first_s` every `step_s`.
    """

    sensor: int
    x_m: float
    y_m: float
    model: AmplitudeModel
    profile: Profile
    first_s: float
    step_s: float
    samples: int


class PassStream(NamedTuple):
    """What has been said of one pass: `messages` in order of their sensors, one a sensor.

    `linear` is the sum of their equations (8 unknowns), counted from the first message's sensor and
    time; None before the first.
    """

    messages: tuple[SensorMessage, ...] = ()
    linear: LiftedSum | None = None


def added(stream: PassStream, message: SensorMessage) -> PassStream:
    """Return the stream with one more message; a second one of a sensor takes the first's place.

    So a sensor may send again when it knows better, and a message that comes twice counts once.
    """
    place = bisect_left(stream.messages, message.sensor, key=_number)
    known = place < len(stream.messages) and stream.messages[place].sensor == message.sensor
    if known and stream.messages[place] == message:
        return stream
    rest = stream.messages[place + 1 :] if known else stream.messages[place:]
    messages = (*stream.messages[:place], message, *rest)
    if known:  # sums forget nothing: it is made again
        linear = None
        for one in messages:
            linear = _summed(linear, one)
        return PassStream(messages, linear)
    return PassStream(messages, _summed(stream.linear, message))


def first_guess(stream: PassStream) -> LiftedPass | None:
    """Solve the linear equations, at a cost that does not grow with the messages: a start.

    None before the first message. Position and velocity are of time 0.
    """
    if stream.linear is None:
        return None
    return stream.linear.solved(exponent=stream.messages[0].model.exponent)


def estimated(
    stream: PassStream, *, start_s: float = 0.0, settings: PassSettings | None = None
) -> Passes:
    """Fuse what is there: all trajectories that explain it, see `pass_fusion.fuse`."""
    return fuse(together(stream.messages, start_s=start_s), settings=settings)


def together(messages: Sequence[SensorMessage], *, start_s: float = 0.0) -> PassMessages:
    """Columns of messages, in their order; `start_s` is when a trajectory's position is told."""
    return PassMessages(
        sensors=np.array([(m.x_m, m.y_m) for m in messages], float).reshape(-1, 2),
        models=tuple(m.model for m in messages),
        profiles=np.array([tuple(m.profile) for m in messages], float).reshape(-1, 3),
        records=PassRecords(
            _column([m.first_s for m in messages]),
            _column([m.step_s for m in messages]),
            _column([m.samples for m in messages]),
        ),
        start_s=start_s,
    )


def _summed(linear: LiftedSum | None, message: SensorMessage) -> LiftedSum:
    """Add a message's equations; one that heard nothing has none."""
    where = np.array([message.x_m, message.y_m])
    total = linear or pass_lifted.empty(where, time_s=float(message.profile.t_max_s))
    if message.profile.a_max <= 0.0 or message.profile.width_s <= 0.0:
        return total
    fisher = fishers(together([message]))[0]
    return total.added(message.profile, fisher, where, exponent=message.model.exponent)


def _number(message: SensorMessage) -> int:
    return message.sensor


def _column(values: Sequence[float]) -> Vector:
    return np.array(values, float)
