"""A step of the tracker of angles in NumPy, from the filters of the room: twin of the kernel."""

import numpy as np
from scipy.special import softmax
from scipy.stats import norm

from trackfield.filtering import angle_readings, angle_step, extended, interacting
from trackfield.filtering.angle_readings import Says
from trackfield.filtering.interacting import Bank
from trackfield.motion import ConstantVelocity

ITERATION = extended.Iteration(angle_step.STEPS, 2, angle_step.HALVINGS, angle_step.TOLERANCE)


def weigh(residual, spread, variance):
    """Mean precision over the kinds of readings, and the share of the usual kind."""
    shares, spreads = np.array(angle_step.KINDS).T
    extra = spreads**2 * variance[..., None]
    scale = np.sqrt(spread[..., None] + extra)
    p = softmax(np.log(shares) + norm.logpdf(residual[..., None], scale=scale), axis=-1)
    precision = (p / (variance[..., None] + extra)).sum(-1)
    return extended.Noise(np.zeros_like(residual), 1.0 / precision, p[..., 0])


class Readings:
    """Readings as the prior makes them plain: `z` and `R` (..., m), motion with a sign in 2-D."""

    def __init__(self, prior, sensors, value):
        self.sensors = sensors
        self.plain = angle_readings.AngleReadings(sensors, value)
        self.sized = (sensors.says == Says.MOTION) & (prior.mean.shape[-1] == 4)
        if self.sized.any() and not self.sized.all():
            signed = type(sensors)(*(column[~self.sized] for column in sensors))
            prior = iterated(prior, signed, value[..., ~self.sized]).update.posterior
        h, H = self.predict(prior.mean), self.jacobian(prior.mean)
        R = np.broadcast_to(sensors.sigma**2, h.shape)
        S = np.einsum("...mi,...ij,...mj->...m", H, prior.covariance, H) + R
        sign = np.tanh(h * value / S)
        self.z = np.where(self.sized, sign * value, value)
        self.R = np.where(self.sized, R + (1.0 - sign**2) * value**2, R)

    def predict(self, state):
        return np.where(self._in_plane(state), self._signed(state), self.plain.predict(state))

    def jacobian(self, state):
        sign = np.where(self._in_plane(state), np.sign(self._signed(state)), 1.0)
        return sign[..., None] * self.plain.jacobian(state)

    def variance(self, reading):
        return np.broadcast_to(self.R, reading.shape)

    def _in_plane(self, state):
        return (self.sensors.says == Says.MOTION) & (state.shape[-1] == 4)

    def _signed(self, state):
        off = state[..., None, :2] - self.sensors.place[:, :2]
        v = state[..., None, -2:]
        cross = off[..., 0] * v[..., 1] - off[..., 1] * v[..., 0]
        return cross / np.hypot(off[..., 0], off[..., 1]) ** (self.sensors.falloff + 1.0)


def iterated(prior, sensors, value):
    readings = Readings(prior, sensors, value)
    return extended.iterate(prior, readings.z, readings, weigh=weigh, iteration=ITERATION)


def advance(modes, sensors, value, *, dt_s, motions):
    """Return the modes (H, M) after a step, their log likelihood (H,), and the prior's moments."""
    d = modes.beliefs.mean.shape[-1] // 2
    bank = Bank(tuple(ConstantVelocity(q, d) for q in motions.densities), motions.stays_s)
    prior = interacting.predict(modes, bank, dt_s=dt_s)
    usual = angle_step.KINDS[0][0]

    def rule(belief, z):
        del z
        found = iterated(belief, sensors, value)
        t = np.clip(found.noise.trust, 1e-12, 1 - 1e-12)
        doubt = t * np.log(t / usual) + (1 - t) * np.log((1 - t) / (1 - usual))
        log_likelihood = found.update.log_likelihood - doubt.sum(-1)
        return found.update._replace(log_likelihood=log_likelihood)

    z = np.tile(value, (len(modes.weights), 1))
    after, info = interacting.update(prior, z, rule)
    return after, info.log_likelihood, interacting.combined(prior)
