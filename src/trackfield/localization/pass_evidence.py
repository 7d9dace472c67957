"""How well any trajectory explains each message: twice the likelihood it costs, message by message.

As `pass_fusion` has it: the told profile, laid over the sensor's record again, in place of samples.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.localization.pass_messages import PassMessages, checked
from trackfield.sensing.profile import steepness
from trackfield.types import Matrix, Vector

_CLOCK_STEPS = 4
_CLOCK_MOST = 6.0  # standard deviations by which a clock may be off, at most
NODES = 256  # samples of a record that are looked at, at most, evenly


class PassEvidence(NamedTuple):
    """Samples of told profiles (n, m): when, how strong, for how many of the record each stands.

    (n,) each: the sensors' noise and clocks, whether they fade, and the `loudness` of it all, which
    is the squared misfit of silence.
    """

    sensors: Matrix
    t_s: Matrix
    told: Matrix
    weight: Matrix
    sigma: Vector
    fading: NDArray[np.bool_]
    clock_sigma_s: Vector
    loudness: Vector


def evidence(messages: PassMessages) -> PassEvidence:
    """Lay messages over their records; times are counted from `messages.start_s`."""
    checked(messages)
    first, step, count = (np.asarray(column, float) for column in messages.records)
    most = int(min(count.max(initial=1.0), NODES))
    own = np.minimum(count, most)[:, None]
    stride = count[:, None] / own
    inside = np.arange(most) < own
    place = np.where(inside, np.arange(most), 0) * stride + 0.5 * (stride - 1.0)
    t_s = (first - messages.start_s)[:, None] + step[:, None] * place
    a, t_max, width = np.asarray(messages.profiles, float).T
    t_max = t_max - messages.start_s
    alpha = messages.models[0].exponent if messages.models else 1.0
    tau = (t_s - t_max[:, None]) / np.where(width > 0.0, width, 1.0)[:, None]
    falloff = (1.0 + steepness(alpha) * tau**2) ** (-0.5 * alpha)
    silent = PassEvidence(
        sensors=np.asarray(messages.sensors, float),
        t_s=t_s,
        told=(a * (width > 0.0))[:, None] * falloff,
        weight=inside * stride,
        sigma=np.array([model.sigma for model in messages.models], float),
        fading=np.array([model.fading == "rayleigh" for model in messages.models], bool),
        clock_sigma_s=np.array([model.clock_sigma_s for model in messages.models], float),
        loudness=np.zeros(len(messages.models)),
    )
    return silent._replace(loudness=_deviance(silent, np.zeros(t_s.shape)))


def misfits(given: PassEvidence, theta: Vector, *, exponent: float = 1.0) -> Vector:
    """Squared misfit (n,) of messages under the pass `theta` (5,): 3 on average if they are of it.

    `theta` is P, position at the messages' `start_s`, velocity. A clock that may be wrong is put
    right first, as far as that pays.
    """
    ahead = np.zeros(given.sigma.shape)
    doubtful = given.clock_sigma_s > 0.0
    prior = np.where(doubtful, 1.0 / np.where(doubtful, given.clock_sigma_s, 1.0) ** 2, 0.0)
    a, slope = _amplitudes(given, theta, exponent, ahead)
    for _ in range(_CLOCK_STEPS if doubtful.any() else 0):
        push, grip = _pull(given, a, slope)
        step = (push - prior * ahead) / np.where(doubtful, grip + prior, 1.0)
        most = _CLOCK_MOST * given.clock_sigma_s
        ahead = np.clip(ahead + np.where(doubtful, step, 0.0), -most, most)
        a, slope = _amplitudes(given, theta, exponent, ahead)
    return _deviance(given, a) + prior * ahead**2


def _amplitudes(
    given: PassEvidence, theta: Vector, exponent: float, ahead_s: Vector
) -> tuple[Matrix, Matrix]:
    """Amplitudes (n, m) of a pass to clocks that are ahead, and their slope in that."""
    offset = theta[1:3] + (given.t_s - ahead_s[:, None])[..., None] * theta[3:5]
    offset = offset - given.sensors[:, None]
    r = np.maximum(np.linalg.norm(offset, axis=-1), 1e-9)
    a = np.sqrt(theta[0]) * r**-exponent
    return a, exponent * a * (offset @ theta[3:5]) / r**2


def _pull(given: PassEvidence, a: Matrix, slope: Matrix) -> tuple[Vector, Vector]:
    """Score and information (n,) about each clock."""
    noise = given.sigma[:, None] ** 2
    v = np.where(given.fading[:, None], noise + a**2, noise)
    excess = np.where(given.fading[:, None], given.told**2 - a**2, given.told - a)
    lift = np.where(given.fading[:, None], 2.0 * a, 1.0) * slope
    score = excess * lift / np.where(given.fading[:, None], v**2, v)
    grip = lift**2 / np.where(given.fading[:, None], v**2, v)
    return np.sum(given.weight * score, axis=1), np.sum(given.weight * grip, axis=1)


def _deviance(given: PassEvidence, a: Matrix) -> Vector:
    """Squared misfit (n,) of amplitudes `a` (n, m) in place of the told ones."""
    sigma = given.sigma[:, None]
    plain = ((given.told - a) / sigma) ** 2
    ratio = (sigma**2 + given.told**2) / (sigma**2 + a**2)
    faded = 2.0 * (ratio - 1.0 - np.log(ratio))
    return np.sum(given.weight * np.where(given.fading[:, None], faded, plain), axis=1)
