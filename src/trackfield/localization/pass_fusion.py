"""Trajectory of a pass from the messages of some sensors: the fusion center of Berger III-B.

`fuse(messages)` is the default, `fuse_as_printed(messages, fishers)` the paper's way. Both give
`Passes`: all trajectories that explain the messages, best first, with weights.

The paper treats a message as a Gaussian about what it says, with the Fisher matrix there, Berger
(18). That is wrong where a sensor heard little: its message may be far off and its Fisher matrix
with it. But the fusion center knows how the sensor sampled and its noise; so here it lays the told
profile over the sensor's record again and asks how well a trajectory's profile explains that
(`_core/passes_message.hpp`). To first order this is (18); for weak messages it is much nearer to
the likelihood of the samples themselves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from trackfield._core import _passes
from trackfield.errors import InputError
from trackfield.localization.pass_messages import PassMessages, checked
from trackfield.types import Matrix, Vector

LEAST_SENSORS = 3
SURE = 0.95  # weight of the best trajectory from which on the others need no mention
VAGUE = (
    0.7  # standard deviation of log Q, log speed or heading beyond which no number is to be used
)
DOUBT = 1e-6  # probability of a deviance as large as that of messages which contradict each other
LOUD = 25.0  # deviance of no target from which on a message is about one; noise alone makes 10
NOISE_GAIN = (12.0, 0.5)  # log-likelihood that noise alone does not gain, and more of it per sensor
MOST_PAIRED = 64  # sensors of which all pairs are tried; time would grow with the cube
_NONE = np.zeros((0, 3, 3))


class PassVerdict(IntEnum):
    """What a result is worth; `PASS_REASONS` says it in words."""

    GOOD = 0
    AMBIGUOUS = 1
    UNCERTAIN = 2
    CONTRADICTORY = 3
    TOO_FEW = 4
    NOTHING = 5


PASS_REASONS: Mapping[PassVerdict, str] = {
    PassVerdict.GOOD: "One trajectory explains the messages.",
    PassVerdict.AMBIGUOUS: "Several trajectories explain the messages about as well.",
    PassVerdict.UNCERTAIN: "The messages hardly fix the trajectory, or nothing was seen to pass.",
    PassVerdict.CONTRADICTORY: "No straight pass of one target explains the messages.",
    PassVerdict.TOO_FEW: "Fewer than three sensors at different places heard the target.",
    PassVerdict.NOTHING: "What was heard is no more than noise makes, or heard by fewer than two.",
}


@dataclass(frozen=True, slots=True)
class PassSettings:
    """How messages are fused.

    `starts`: "loudest" sets out from the lifted linear solution and the pairs of the four loudest
    sensors, "all" from all pairs (of the `MOST_PAIRED` loudest). The `searches` best starts are
    followed to the end. An `exponent_sigma` above 0 makes the exponent an unknown with the prior
    N(model's, sigma^2).
    """

    starts: Literal["loudest", "all"] = "loudest"
    searches: int = 6
    exponent_sigma: float = 0.0


class Passes(NamedTuple):
    """Trajectories that explain one pass, the likeliest first; none (k = 0) is possible.

    `theta` (k, 5): power P, position (2) at `start_s`, velocity (2); `exponent` (k,). `covariance`
    (k, 5, 5) of theta, (k, 6, 6) with an unknown exponent. `weight` (k,) is each one's probability,
    given that it is one of them; `gain` (k,) the log-likelihood gained over no target at all.
    `deviance` (k, n) is the squared misfit of each message, 3 n - 5 on average in all; `ahead_s`
    (k, n) how far each clock is ahead. `converged` (k,) says where a search ended at a minimum.
    """

    theta: Matrix
    covariance: Matrix
    exponent: Vector
    weight: Vector
    gain: Vector
    deviance: Matrix
    ahead_s: Matrix
    converged: NDArray[np.bool_]
    verdict: PassVerdict


def fuse(messages: PassMessages, *, settings: PassSettings | None = None) -> Passes:
    """Find all trajectories that explain the messages, and say how far each is to be believed.

    Starts (`PassSettings`) are searched from by Levenberg-Marquardt on the deviance of the told
    profiles; the covariance is the inverse Fisher matrix at the fused trajectory, so that a weak
    message cannot be trusted more than it deserves. A weight is exp(-deviance / 2), times N(0, R^2)
    in the distance at which the target passes the middle of the sensors, R their root mean square
    distance from there; all of them together are 1.

    Sensors whose `clock_sigma_s` is above 0 get their clock's error estimated along. `InputError`
    for messages that are none; for messages that say too little, see `Passes.verdict`.
    """
    chosen = PassSettings() if settings is None else settings
    pairs_of = MOST_PAIRED if chosen.starts == "all" else 4
    return _fused(messages, _NONE, chosen.exponent_sigma, (pairs_of, chosen.searches))


def fuse_as_printed(
    messages: PassMessages, fishers: Matrix, *, exponent_sigma: float = 0.0
) -> Passes:
    """Paper mode: the minimum of Berger (18) next to the best of all pairs' closed forms.

    `fishers` (n, 3, 3) are the messages' own (`pass_messages.fishers`). One trajectory comes back;
    nothing is said of others.
    """
    J = np.ascontiguousarray(fishers, float)
    if J.shape != (len(messages.models), 3, 3) or not np.isfinite(J).all():
        raise InputError(f"fishers of shape {J.shape}: expected (n, 3, 3), one a message, finite")
    return _fused(messages, J, exponent_sigma, (MOST_PAIRED, 1))


def _fused(
    messages: PassMessages, fishers: Matrix, exponent_sigma: float, search: tuple[int, int]
) -> Passes:
    checked(messages)
    if not 0.0 <= exponent_sigma < np.inf:
        raise InputError(f"exponent_sigma: found {exponent_sigma}, expected 0 or more")
    size = 6 if exponent_sigma > 0.0 else 5
    n, places = len(messages.models), _places(messages)
    if places < 2:
        return _nothing(n, size)
    profiles = np.array(messages.profiles, float)
    profiles[:, 1] -= messages.start_s
    sensors = np.ascontiguousarray(messages.sensors, float)
    rounding = _NONE if messages.rounding is None else np.ascontiguousarray(messages.rounding)
    states, within, merit, half, late, silence, time_s = _passes.modes(
        sensors, profiles, _table(messages), fishers, rounding,
        messages.models[0].exponent, exponent_sigma, *search,
    )  # fmt: skip
    if not len(states):
        return _nothing(n, size)
    theta, covariance = _told(states, within[:, :size, :size], time_s)
    found = Passes(
        theta=theta,
        covariance=covariance,
        exponent=states[:, 5],
        weight=merit[:, 1],
        gain=0.5 * silence.sum() - half.sum(axis=1),
        deviance=2.0 * half,
        ahead_s=late,
        converged=merit[:, 2] > 0.0,
        verdict=PassVerdict.GOOD,
    )
    lengths = messages.records.step_s * messages.records.samples
    passed = ((silence >= LOUD) & (messages.profiles[:, 2] < lengths)).any()
    fixed = merit[0, 3] > 0.0 and within[0].diagonal()[3:5].max() < VAGUE**2
    sure = bool(passed and fixed and found.converged[0] and np.isfinite(theta[0]).all())
    return found._replace(verdict=_verdict(found, silence, places=places, sure=sure))


def _table(messages: PassMessages) -> Matrix:
    """List records for the kernel, (n, 7): first time, step, count, and what the models say."""
    table = np.empty((len(messages.models), 7))
    first, table[:, 1], table[:, 2] = messages.records
    table[:, 0] = first - messages.start_s
    table[:, 3:] = [
        (m.sigma, m.clock_sigma_s, m.fading == "rayleigh", m.saturation) for m in messages.models
    ]
    return table


def _told(states: Matrix, within: Matrix, time_s: float) -> tuple[Matrix, Matrix]:
    """Theta and covariance of states [log Q, x, y, log speed, heading, exponent] at `time_s`."""
    q, _, _, log_speed, heading, alpha = states.T
    k, size = within.shape[:2]
    theta, slopes = np.empty((k, 5)), np.zeros((k, size, size))
    speed = np.exp(log_speed)
    theta[:, 0] = np.exp(alpha * q)
    theta[:, 3], theta[:, 4] = speed * np.cos(heading), speed * np.sin(heading)
    theta[:, 1:3] = states[:, 1:3] - time_s * theta[:, 3:]
    slopes[:, 3:5, 3] = theta[:, 3:]
    slopes[:, 3, 4], slopes[:, 4, 4] = -theta[:, 4], theta[:, 3]
    slopes[:, 1:3, 3:5] = -time_s * slopes[:, 3:5, 3:5]
    slopes[:, 0, 0] = alpha * theta[:, 0]
    slopes[:, 1, 1] = slopes[:, 2, 2] = 1.0
    if size > 5:
        slopes[:, 0, 5], slopes[:, 5, 5] = q * theta[:, 0], 1.0
    return theta, slopes @ within @ slopes.transpose(0, 2, 1)


def _verdict(found: Passes, silence: Vector, *, places: int, sure: bool) -> PassVerdict:
    if found.gain.max() < NOISE_GAIN[0] + NOISE_GAIN[1] * silence.size:
        return PassVerdict.NOTHING
    if places < LEAST_SENSORS:
        return PassVerdict.TOO_FEW
    # the best fit to noise alone lies far from any truth: twice what a loud message does
    degrees = 3 * silence.size - 5 + 3 * int((silence < LOUD).sum())
    if found.deviance.sum(axis=1).min() > chdtri(degrees, DOUBT):
        return PassVerdict.CONTRADICTORY
    if not sure:
        return PassVerdict.UNCERTAIN
    return PassVerdict.GOOD if found.weight[0] >= SURE else PassVerdict.AMBIGUOUS


def _places(messages: PassMessages) -> int:
    """Count different places of sensors that heard something."""
    heard = (messages.profiles[:, 0] > 0.0) & (messages.profiles[:, 2] > 0.0)
    return len({(x, y) for x, y in messages.sensors[heard].tolist()})


def _nothing(n: int, size: int) -> Passes:
    none = np.zeros(0)
    return Passes(
        theta=np.zeros((0, 5)),
        covariance=np.zeros((0, size, size)),
        exponent=none,
        weight=none,
        gain=none,
        deviance=np.zeros((0, n)),
        ahead_s=np.zeros((0, n)),
        converged=np.zeros(0, bool),
        verdict=PassVerdict.NOTHING,
    )
