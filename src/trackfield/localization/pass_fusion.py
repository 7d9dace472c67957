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
_EVERY = 1_000_000
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
    PassVerdict.UNCERTAIN: "The messages hardly fix the trajectory; its covariance is no use.",
    PassVerdict.CONTRADICTORY: "No straight pass of one target explains the messages.",
    PassVerdict.TOO_FEW: "Fewer than three sensors at different places heard the target.",
    PassVerdict.NOTHING: "No two sensors heard a target that moves.",
}


@dataclass(frozen=True, slots=True)
class PassSettings:
    """How messages are fused.

    `starts`: "loudest" sets out from the lifted linear solution and the pairs of the four loudest
    sensors, "all" from all pairs. The `searches` best starts are followed to the end. An
    `exponent_sigma` above 0 makes the exponent an unknown with the prior N(model's, sigma^2).
    """

    starts: Literal["loudest", "all"] = "loudest"
    searches: int = 6
    exponent_sigma: float = 0.0


class Passes(NamedTuple):
    """Trajectories that explain one pass, the likeliest first; none (k = 0) is possible.

    `theta` (k, 5): power P, position (2) at `start_s`, velocity (2); `exponent` (k,). `covariance`
    (k, 5, 5) of theta, (k, 6, 6) with an unknown exponent. `weight` (k,) is each one's probability,
    given that it is one of them. `deviance` (k, n) is the squared misfit of each message, 3 n - 5
    on average in all; `ahead_s` (k, n) how far each clock is ahead. `converged` (k,).
    """

    theta: Matrix
    covariance: Matrix
    exponent: Vector
    weight: Vector
    deviance: Matrix
    ahead_s: Matrix
    converged: NDArray[np.bool_]
    verdict: PassVerdict


def fuse(messages: PassMessages, *, settings: PassSettings | None = None) -> Passes:
    """Find all trajectories that explain the messages, and say how far each is to be believed.

    Starts (`PassSettings`) are searched from by Levenberg-Marquardt on the deviance of the told
    profiles; the covariance is the inverse Fisher matrix at the fused trajectory, so that a weak
    message cannot be trusted more than it deserves. Weights are Laplace's, under a prior that is
    flat in log power, log speed, heading and time, and N(0, R^2) in the distance at which the
    target passes the middle of the sensors, R their root mean square distance from there.

    Sensors whose `clock_sigma_s` is above 0 get their clock's error estimated along. `InputError`
    for messages that are none; for messages that say too little, see `Passes.verdict`.
    """
    chosen = PassSettings() if settings is None else settings
    pairs_of = _EVERY if chosen.starts == "all" else 4
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
    return _fused(messages, J, exponent_sigma, (_EVERY, 1))


def _fused(
    messages: PassMessages, fishers: Matrix, exponent_sigma: float, search: tuple[int, int]
) -> Passes:
    checked(messages)
    if not 0.0 <= exponent_sigma < np.inf:
        raise InputError(f"exponent_sigma: found {exponent_sigma}, expected 0 or more")
    size = 6 if exponent_sigma > 0.0 else 5
    n = len(messages.models)
    if n < 2 or (n and _places(messages) < 2):
        return _nothing(n, size)
    records = np.empty((n, 6))
    records[:, 0] = messages.records.first_s - messages.start_s
    records[:, 1], records[:, 2] = messages.records.step_s, messages.records.samples
    for k, model in enumerate(messages.models):
        records[k, 3:] = model.sigma, model.clock_sigma_s, model.fading == "rayleigh"
    profiles = np.array(messages.profiles, float)
    profiles[:, 1] -= messages.start_s
    states, within, merit, half, late, time_s = _passes.modes(
        np.ascontiguousarray(messages.sensors, float), profiles, records, fishers,
        messages.models[0].exponent, exponent_sigma, *search,
    )  # fmt: skip
    if not len(states):
        return _nothing(n, size)
    theta, covariance = _told(states, within[:, :size, :size], time_s)
    converged = merit[:, 2] > 0.0
    given = (theta, covariance, states[:, 5], merit[:, 1], 2.0 * half, late, converged)
    spread = np.diagonal(within[0])[[0, 3, 4]].max()
    sure = bool(merit[0, 3] > 0.0 and spread < VAGUE**2 and np.isfinite(theta[0]).all())
    found = Passes(*given, PassVerdict.GOOD)
    return found._replace(verdict=_verdict(messages, found, sure=sure))


def _told(states: Matrix, within: Matrix, time_s: float) -> tuple[Matrix, Matrix]:
    """Theta and covariance of states [log Q, x, y, log speed, heading, exponent] at `time_s`."""
    q, x, y, log_speed, heading, alpha = states.T
    size = within.shape[-1]
    v = np.exp(log_speed)[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
    across = np.column_stack([-v[:, 1], v[:, 0]])
    power = np.exp(alpha * q)
    theta = np.column_stack([power, np.column_stack([x, y]) - time_s * v, v])
    slopes = np.zeros((len(states), size, size))
    slopes[:, 0, 0] = alpha * power
    slopes[:, 1, 1] = slopes[:, 2, 2] = 1.0
    slopes[:, 1:3, 3], slopes[:, 1:3, 4] = -time_s * v, -time_s * across
    slopes[:, 3:5, 3], slopes[:, 3:5, 4] = v, across
    if size == 6:
        slopes[:, 0, 5], slopes[:, 5, 5] = q * power, 1.0
    return theta, slopes @ within @ np.swapaxes(slopes, -1, -2)


def _verdict(messages: PassMessages, found: Passes, *, sure: bool) -> PassVerdict:
    best = int(np.argmin(found.deviance.sum(axis=1)))
    degrees = max(3 * len(messages.models) - 5, 1)
    if _places(messages) < LEAST_SENSORS:
        return PassVerdict.TOO_FEW
    if found.deviance[best].sum() > chdtri(degrees, DOUBT):
        return PassVerdict.CONTRADICTORY
    if not sure or not found.converged[0]:
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
        deviance=np.zeros((0, n)),
        ahead_s=np.zeros((0, n)),
        converged=np.zeros(0, bool),
        verdict=PassVerdict.NOTHING,
    )
