"""Passes through the field of Berger's Fig. 4, in metres, and what its sensors say of them."""

import numpy as np

from trackfield.localization.pass_messages import PassMessages, PassRecords
from trackfield.localization.pass_stream import SensorMessage
from trackfield.sensing.amplitude import noisy
from trackfield.sensing.profile import profile_of
from trackfield.sensing.profile_fit import fit

FIELD = 1000.0 * np.array(
    [
        *[(-1.20, 0.80), (0.95, -0.85), (0.25, 0.45), (-0.60, -1.10), (1.40, 0.90)],
        *[(-1.70, -1.50), (-0.30, 1.60), (1.75, -0.30), (0.30, -1.75), (-1.85, 0.15)],
        *[(-1.50, 1.75), (0.70, 1.30), (1.80, 1.80), (1.60, -1.60), (-1.05, -0.45)],
        *[(-0.35, 0.30), (0.55, -0.25), (1.10, -0.15), (-1.25, -1.90), (0.15, 1.95)],
    ]
)
TARGETS = np.array(
    [
        [1e6, -2400.0, -500.0, 196.0, 40.0],
        [1e6, 2200.0, 1200.0, -180.0, -86.0],  # as loud and as fast: of the same invariant
        [0.5e6, -900.0, -2400.0, 50.0, 200.0],
    ]
)
TIMES = np.arange(25.0)


def amplitudes(theta, model, *, times=TIMES, clocks=0.0, sensors=FIELD):
    """Amplitudes (n, m) of one pass without noise; sensor k's clock is `clocks[k]` ahead."""
    t = times - np.broadcast_to(clocks, (len(sensors),))[:, None]
    place = theta[1:3] + t[..., None] * theta[3:5]
    return np.sqrt(theta[0]) * np.linalg.norm(place - sensors[:, None], axis=-1) ** -model.exponent


def told(targets, model, rng, *, times=TIMES, sensors=FIELD):
    """Profiles (k, n, 3) that each sensor fits to each target's amplitudes, heard apart."""
    clocks = model.clock_sigma_s * rng.standard_normal(len(sensors))
    heard = [amplitudes(one, model, times=times, clocks=clocks, sensors=sensors) for one in targets]
    return np.array([fit(model, times, noisy(model, a, rng=rng)).profile.array() for a in heard])


def shuffled(profiles, model, rng, *, times=TIMES, sensors=FIELD):
    """Messages of all targets in any order, whose sensor and target each is (n,)."""
    k, n = profiles.shape[:2]
    order = rng.permutation(k * n)
    count = np.full(k * n, 1.0)
    step = times[1] - times[0]
    sensor = np.tile(np.arange(n, dtype=np.int32), k)[order]
    messages = PassMessages(
        sensors[sensor],
        (model,) * (k * n),
        profiles.reshape(-1, 3)[order],
        PassRecords(count * times[0], count * step, count * times.size),
    )
    return messages, sensor, np.repeat(np.arange(k), n)[order]


def messages_of(profiles, model, *, times=TIMES, sensors=FIELD):
    """One pass's messages (n, 3) as values, sensor by sensor."""
    record = times[0], times[1] - times[0], times.size
    return [
        SensorMessage(k, *sensors[k].tolist(), model, profile_of(psi), *record)
        for k, psi in enumerate(profiles)
    ]


def nearest(theta, targets=TARGETS):
    """Which target a trajectory is, and how far from it in the middle of the pass [m]."""
    apart = np.hypot(*((theta[1:3] + 12 * theta[3:5]) - (targets[:, 1:3] + 12 * targets[:, 3:5])).T)
    return int(np.argmin(apart)), float(apart.min())
