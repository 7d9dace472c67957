"""The compiled tracker's twin: one target, plain NumPy, slow, each formula in its textbook form.

Motion by matrix exponentials, robust updates by mixing three Kalman posteriors, smoothing by a
Rauch-Tung-Striebel pass over stored steps: nothing is computed the way the kernel does it.
"""

import math
from typing import NamedTuple
from unittest import mock

import numpy as np
from scipy.linalg import expm, expm_frechet
from scipy.special import logsumexp

from trackfield._core._kernels import RangeBank
from trackfield.filtering import range_tracker
from trackfield.pipeline.tagged import Tracker


class Told(NamedTuple):
    """A tracker, and what the kernel in it was told."""

    tracker: Tracker
    settings: dict
    models: list


def told(site, *, lag_s=0.0, lag_steps=0, every_s=0.0, **changed) -> Told:
    """Make a tracker with some of the kernel's settings changed."""
    heard = []

    def kernel(settings, table):
        heard.append(({**settings, **changed}, [Model(*row) for row in table]))
        return RangeBank(heard[-1][0], table)

    with mock.patch.object(range_tracker, "RangeBank", kernel):
        tracker = Tracker(site, lag_s=lag_s, lag_steps=lag_steps, every_s=every_s)
    return Told(tracker, *heard[-1])


class Model(NamedTuple):
    """One sensor, in the order of the kernel's table."""

    x: float
    y: float
    z: float = 0.0
    bias: float = 0.0
    scale: float = 0.0
    variance: float = 0.0225
    scale_variance: float = 0.0
    max_range: float = 1e300
    correlated_sigma: float = 0.0
    correlation_length: float = 1.0
    bias_sigma: float = 0.0
    learn: float = 0.0
    placement_variance: float = 0.0


class Row(NamedTuple):
    t: float
    mean: np.ndarray
    covariance: np.ndarray
    nis: float


class Passed(NamedTuple):
    """What a step leaves for smoothing: cov(x before, x after) and the prediction."""

    cross: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray


class Slot(NamedTuple):
    sensor: int = -1
    last: float = -math.inf
    weight: float = 0.0
    power: float = 0.0


class Twin:
    """Belief of one target from a given start on; `step` takes the readings of one time."""

    def __init__(self, settings, models) -> None:
        self.s, self.models = dict(settings), models
        s, D = self.s, settings["dimensions"]
        self.D, size = D, 2 * D
        self.at = {}
        for name, there in (
            ("height", s["height_open"]),
            ("turn", any(m["turns"] for m in s["modes"])),
            ("scale", s["scale_sigma"] > 0),
            ("bias", s["common_bias_sigma"] > 0),
        ):
            if there:
                self.at[name] = size
                size += 1
        self.own = [name for name in ("slot_bias", "slot_correlated") if s[name]]
        self.slot0 = size
        self.n = size + len(self.own) * s["slots"]

    def start(self, t, position, covariance):
        s, n, D = self.s, self.n, self.D
        sigma2 = np.full(n, 1e-12)
        sigma2[D : 2 * D] = s["velocity_sigma"] ** 2
        mean = np.zeros(n)
        mean[:D] = position
        for name, at in self.at.items():
            key = "common_bias_sigma" if name == "bias" else name + "_sigma"
            sigma2[at] = s[key] ** 2
            mean[at] = s["height"] if name == "height" else 0.0
        P = np.diag(sigma2)
        P[:D, :D] = covariance
        M = len(s["modes"])
        self.t, self.p = t, np.full(M, 1.0 / M)
        self.x, self.P = np.tile(mean, (M, 1)), np.tile(P, (M, 1, 1))
        self.slots = [Slot() for _ in range(s["slots"])]
        self.pool_weight = self.pool_power = 0.0
        self.heard = np.zeros(3)
        self.passed: list[Passed] = []
        self.rows = [Row(t, mean, P, math.nan)]

    def step(self, t, scan):
        self.predict(t, scan)
        nis = np.mean([min(self.nis(z), 9.0) for z in scan])
        likelihoods = np.array([self.condition(j, scan) for j in range(len(self.p))])
        p = self.p * np.exp(likelihoods - likelihoods.max())
        p = np.maximum(p, 1e-12)
        self.p = p / p.sum()
        self.learn(scan)
        self.rows.append(Row(t, *self.moments(), nis))

    def moments(self):
        """Mean and covariance of all modes together."""
        return moments(self.p, self.x, self.P)

    # Prediction ---------------------------------------------------------------------------------

    def predict(self, t, scan):
        s, D, dt = self.s, self.D, t - self.t
        before, spread = self.moments()
        speed2 = sum(before[i] ** 2 + spread[i, i] for i in range(D, 2 * D))
        keep, fresh_noise = self.renewed(t, scan, travelled=math.sqrt(speed2) * dt)
        x0, P0 = self.mixed(dt)
        cross, joint = [], []
        for j, mode in enumerate(s["modes"]):
            x, P, F = x0[j], P0[j], np.eye(self.n)
            for some, turning, outage in self.legs(mode, dt):
                x, A, Q = self.moved(x, mode, some, turning=turning, outage=outage)
                P, F = A @ P @ A.T + Q, A @ F
            x, F = self.toward_prior(x, keep), keep[:, None] * F
            P = keep[:, None] * P * keep + np.diag(fresh_noise)
            cross.append(P0[j] @ F.T)
            joint.append(x)
            self.P[j] = P
        self.x = np.array(joint)
        after, spread = self.moments()
        moved = np.einsum("j,ja,jb->ab", self.p, x0 - before, self.x - after)
        self.passed.append(Passed(np.einsum("j,jab->ab", self.p, cross) + moved, after, spread))
        self.t = t

    def legs(self, mode, dt):
        """Short steps, turning or not, then what is left as a silence."""
        s = self.s
        known = min(dt, s["turn_max_step"])
        turning = bool(mode["turns"])
        steps = max(1, math.ceil(known / s["turn_step"] - 1e-9)) if turning else 1
        yield from [(known / steps, turning, False)] * steps
        if dt > known:
            yield dt - known, False, True

    def mixed(self, dt):
        M = len(self.p)
        if M == 1:
            return self.x, self.P
        leave = np.array([1 - math.exp(-m["switch_rate"] * dt) for m in self.s["modes"]])
        leave *= (M - 1) / M
        T = np.tile((leave / (M - 1))[:, None], (1, M))
        np.fill_diagonal(T, 1 - leave)
        joint = self.p[:, None] * T
        self.p = joint.sum(0)
        w = joint / self.p
        mixed = [moments(w[:, j], self.x, self.P) for j in range(M)]
        return np.array([x for x, _ in mixed]), np.array([P for _, P in mixed])

    def moved(self, x, mode, dt, *, turning, outage):
        """Mean, slope and noise of one short step of the kinematic block."""
        s, D, n = self.s, self.D, self.n
        beta = 1 / s["outage_velocity_time" if outage else "velocity_time"]
        J = np.zeros((D, D))
        J[0, 1], J[1, 0] = -1.0, 1.0
        omega = x[self.at["turn"]] if turning else 0.0
        G, slope = np.zeros((2, 2 * D, 2 * D))
        G[:D, D:] = np.eye(D)
        G[D:, D:] = omega * J - beta * np.eye(D)
        slope[D:, D:] = J
        F, k = np.eye(n), 2 * D
        F[:k, :k] = expm(G * dt)
        y, Q = np.array(x), np.zeros((n, n))
        y[:k] = F[:k, :k] @ x[:k]
        if "turn" in self.at:
            o = self.at["turn"]
            F[o, o] = math.exp(-dt / s["turn_time"])
            y[o] *= F[o, o]
            Q[o, o] = s["turn_sigma"] ** 2 * (1 - F[o, o] ** 2)
            if turning:
                F[:k, o] = expm_frechet(G * dt, slope * dt, compute_expm=False) @ x[:k]
        pp, pv, vv = decaying_noise(mode["accel_density"], beta, dt)
        Q[:D, :D] += pp * np.eye(D)
        Q[D:k, D:k] += vv * np.eye(D)
        Q[:D, D:k] += pv * np.eye(D)
        Q[D:k, :D] += pv * np.eye(D)
        return y, F, Q

    def renewed(self, t, scan, *, travelled):
        """Share that stays (n,) and new variance (n,) of the states that are not motion."""
        s = self.s
        fresh = []
        for z in scan:
            i = self.slot_of(z.sensor)
            if i is None:
                idle = [
                    k
                    for k, slot in enumerate(self.slots)
                    if slot.sensor < 0 or t - slot.last > s["slot_idle"]
                ]
                if not idle:
                    continue
                i = min(idle, key=lambda k: self.slots[k].last)
                self.slots[i] = Slot(z.sensor)
                fresh.append(i)
            self.slots[i] = self.slots[i]._replace(last=t)
        keep, noise = np.ones(self.n), np.zeros(self.n)
        if "height" in self.at:
            at = self.at["height"]
            keep[at] = math.exp(-(t - self.t) / s["height_time"])
            noise[at] = s["height_sigma"] ** 2 * (1 - keep[at] ** 2)
        for i, slot in enumerate(self.slots):
            if slot.sensor < 0:
                continue
            a = self.models[slot.sensor]
            correlated = self.correlated(a)
            for name in self.own:
                at = self.state_of(i, name)
                if i in fresh:
                    keep[at] = 0.0
                    noise[at] = 1e-12 + (a.bias_sigma**2 if name == "slot_bias" else correlated)
                elif name == "slot_correlated":
                    keep[at] = math.exp(-travelled / a.correlation_length)
                    noise[at] = correlated * (1 - keep[at] ** 2)
        return keep, noise

    def toward_prior(self, x, keep):
        home = np.zeros(self.n)
        if "height" in self.at:
            home[self.at["height"]] = self.s["height"]
        return home + keep * (x - home)

    # Readings -----------------------------------------------------------------------------------

    def expected(self, x, sensor):
        """Reading that is expected at x, its slope, the distance."""
        a, H = self.models[sensor], np.zeros(self.n)
        height = x[self.at["height"]] if "height" in self.at else self.s["height"]
        place = x[:3] if self.D == 3 else np.array([x[0], x[1], height])
        d = place - np.array([a.x, a.y, a.z])
        r = math.sqrt(d @ d)
        scale = 1 + a.scale + (x[self.at["scale"]] if "scale" in self.at else 0.0)
        H[: self.D] = scale * d[: self.D] / r
        if "height" in self.at:
            H[self.at["height"]] = scale * d[2] / r
        if "scale" in self.at:
            H[self.at["scale"]] = r
        added = []
        if "bias" in self.at:
            added.append(self.at["bias"])
        i = self.slot_of(sensor)
        if i is not None:
            added.extend(self.state_of(i, name) for name in self.own)
        H[added] = 1.0
        return scale * r + a.bias + x[added].sum(), H, r

    def variance(self, z, r):
        a, i = self.models[z.sensor], self.slot_of(z.sensor)
        least = 1e-3**2
        if z.sigma > 0:
            v = max(float(np.float32(z.sigma)) ** 2, least) + a.scale_variance * r**2
        else:
            v = max(a.variance, least) + a.scale_variance * r**2
            if a.learn:
                pull = self.s["pool_weight"]
                own = Slot() if i is None else self.slots[i]
                v *= (pull * self.pool() + own.power) / (pull + own.weight)
                v = max(v, self.s["noise_floor"] ** 2)
        if i is None:
            v += a.bias_sigma**2 if "slot_bias" in self.own else 0.0
            v += self.correlated(a) if "slot_correlated" in self.own else 0.0
        return v

    def correlated(self, a):
        return a.correlated_sigma**2 * (self.pool() if a.learn else 1.0)

    def pool(self):
        k = self.s["prior_weight"]
        return (k + self.pool_power) / (k + self.pool_weight)

    def kinds(self, R):
        """Share, shift and added variance of the kinds of reading."""
        s = self.s
        if not s["robust"]:
            return [(1.0, 0.0, 0.0)]
        k, (heard, late, outlying) = s["shares_weight"], self.heard
        p_late = min((k * s["p_nlos"] + late) / (k + heard), 0.5)
        p_out = min((k * s["p_outlier"] + outlying) / (k + heard), 0.3)
        shift = s["nlos_sigmas"] * math.sqrt(R)
        return [
            (1 - p_late - p_out, 0.0, 0.0),
            (p_late, shift, shift**2),
            (p_out, 0.0, s["outlier_sigmas"] ** 2 * R),
        ]

    def nis(self, z):
        mean, P = self.moments()
        h, H, r = self.expected(mean, z.sensor)
        return (z.value - h) ** 2 / (self.variance(z, r) + H @ P @ H)

    def condition(self, j, scan):
        """Iterate the update of one mode; its log-likelihood."""
        prior, P0 = self.x[j].copy(), self.P[j].copy()
        about = prior
        for _ in range(self.s["iterations"]):
            x, P, log_likelihood, limit = prior, P0, 0.0, math.inf
            for z in scan:
                h, H, r = self.expected(about, z.sensor)
                R = self.variance(z, r)
                x, P, one = self.mixture_update(x, P, z.value - h + H @ about, H, R)
                log_likelihood += one
                limit = min(limit, R * r**2)
            step2 = ((x - about)[: self.D] ** 2).sum()
            about = x
            if (step2 / 2) ** 2 < 0.02**2 * limit:  # |dx|^2 / 2r < .02 sigma
                break
        self.x[j], self.P[j] = x, P
        return log_likelihood

    def mixture_update(self, x, P, z, H, R):
        """Moments of the posteriors under each kind of reading, weighted by their evidence."""
        evidence, means, covariances = [], [], []
        for share, shift, extra in self.kinds(R):
            S = H @ P @ H + R + extra
            K = P @ H / S
            e = z - H @ x - shift
            evidence.append(math.log(share) + log_normal(e, S))
            means.append(x + K * e)
            A = np.eye(self.n) - np.outer(K, H)
            covariances.append(A @ P @ A.T + np.outer(K, K) * (R + extra))
        total = logsumexp(evidence)
        weights = np.exp(np.array(evidence) - total)
        return *moments(weights, np.array(means), np.array(covariances)), total

    def learn(self, scan):
        s = self.s
        mean, P = self.moments()
        for z in scan:
            a = self.models[z.sensor]
            if not a.learn or z.sigma > 0:
                continue
            h, H, r = self.expected(mean, z.sensor)
            e, hph, R = z.value - h, H @ P @ H, self.variance(z, r)
            told = R / (R + hph)
            kinds = self.kinds(R)
            evidence = [math.log(p) + log_normal(e - d, R + hph + v) for p, d, v in kinds]
            belongs = np.exp(np.array(evidence) - logsumexp(evidence))
            if s["robust"]:
                news = told * np.array([1.0, belongs[1], belongs[2]])
                self.heard = faded(self.heard, s["memory_shares"], news)
            weight = told * belongs[0]
            factor = (e**2 + hph) / (a.variance + a.scale_variance * r**2)
            power = weight * min(factor, s["worst_factor"])
            self.pool_weight = faded(self.pool_weight, s["memory_pool"], weight)
            self.pool_power = faded(self.pool_power, s["memory_pool"], power)
            i = self.slot_of(z.sensor)
            if i is not None:
                o = self.slots[i]
                self.slots[i] = o._replace(
                    weight=faded(o.weight, s["memory_own"], weight),
                    power=faded(o.power, s["memory_own"], power),
                )

    def slot_of(self, sensor):
        return next((i for i, slot in enumerate(self.slots) if slot.sensor == sensor), None)

    def state_of(self, slot, name):
        return self.slot0 + slot * len(self.own) + self.own.index(name)

    # Smoothing ----------------------------------------------------------------------------------

    def smoothed(self, k, until):
        """Row k given all rows up to `until`: a backward pass over the stored steps."""
        mean, P = self.rows[until].mean, self.rows[until].covariance
        for i in range(until - 1, k - 1, -1):
            step, row = self.passed[i], self.rows[i]
            G = np.linalg.solve(step.covariance + 1e-12 * np.eye(self.n), step.cross.T).T
            mean = row.mean + G @ (mean - step.mean)
            P = row.covariance + G @ (P - step.covariance) @ G.T
        return Row(self.rows[k].t, mean, P, self.rows[k].nis)

    def shown_covariance(self, row):
        """xx, xy, yy of a row: what ranges cannot see is added, at the worst sensor's size."""
        hidden = max(a.placement_variance for a in self.models)
        P = row.covariance
        return [P[0, 0] + hidden, P[0, 1], P[1, 1] + hidden]

    def lagged(self, *, lag_s=0.0, lag_steps=0):
        """Every row as it is shown once it is that old, or at the end."""
        last = len(self.rows) - 1
        ripe = [
            next(
                (
                    j
                    for j in range(k, last + 1)
                    if (j - k >= lag_steps if lag_steps else self.rows[j].t - row.t >= lag_s - 1e-9)
                ),
                last,
            )
            for k, row in enumerate(self.rows)
        ]
        return [self.smoothed(k, until) for k, until in enumerate(ripe)]


def moments(weights, means, covariances):
    """Mean and covariance of a mixture of Gaussians."""
    mean = weights @ means
    apart = means - mean
    return mean, np.einsum("j,jab->ab", weights, covariances) + (apart.T * weights) @ apart


def log_normal(e, S):
    return -0.5 * (e * e / S + math.log(2 * math.pi * S))


def faded(total, memory, news):
    """Sum that forgets: each reading is worth less by 1/memory with every one after it."""
    return total * (1 - 1 / memory) + news


def decaying_noise(q, beta, dt):
    """Var of position, their covariance, var of velocity: white acceleration, dv = -beta v dt.

    Short steps take the position's variance to first order in beta dt.
    """
    x, e = beta * dt, math.exp(-beta * dt)
    vv = q * (1 - e**2) / (2 * beta)
    pv = q * (1 - e) ** 2 / (2 * beta**2)
    exact = q / beta**3 * (x - 2 * (1 - e) + 0.5 * (1 - e**2))
    return (q * dt**3 / 3 * (1 - 0.75 * x) if x < 0.02 else exact), pv, vv
