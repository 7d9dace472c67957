"""The Bernoulli mixture's twin: every joint hypothesis written out, dense matrices, no limits."""

import itertools
import math
from typing import NamedTuple

import numpy as np
from scipy.stats import multivariate_normal, norm

from trackfield._core import _bernoulli as kernel
from trackfield.association.bernoulli_settings import BernoulliSettings, kernel_model

H = np.eye(2, 4)


class Possible(NamedTuple):
    """One target of one hypothesis."""

    first_s: float
    r: float
    mean: np.ndarray
    P: np.ndarray


class Hypothesis(NamedTuple):
    """A joint explanation: its weight, and targets by the number of their first report."""

    weight: float
    targets: dict


def transition(dt_s, step_s, accel_sigma):
    """F and Q of all steps in `dt_s`, multiplied out one by one."""
    n = max(1, round(dt_s / step_s))
    h = dt_s / n
    one = np.block([[np.eye(2), h * np.eye(2)], [np.zeros((2, 2)), np.eye(2)]])
    G = np.vstack([h * h / 2 * np.eye(2), h * np.eye(2)])
    F, Q = np.eye(4), np.zeros((4, 4))
    for _ in range(n):
        F, Q = one @ F, one @ Q @ one.T + accel_sigma**2 * G @ G.T
    return F, Q, n


class Twin:
    """The exact posterior of a scene in which nothing is learned and nothing varies by place."""

    def __init__(self, scene) -> None:
        self.scene = scene
        self.hypotheses = [Hypothesis(1.0, {})]
        self.undetected = None
        self.t = None

    def step(self, t_s, position, sigma_m, number):
        targets, reporting = self.scene.targets, self.scene.reporting
        region, p = reporting.region, float(reporting.p_detection[0])
        if self.t is None:
            self.undetected = targets.initial_count / region.area
        else:
            self._predict(t_s - self.t)
        self.t = t_s
        clutter = reporting.false_per_scan / region.area
        first = p * self.undetected
        rho = clutter + first
        R = sigma_m**2 * np.eye(2)
        following = []
        for hypothesis in self.hypotheses:
            names = list(hypothesis.targets)
            choices = [[-1, *range(len(number))]] * len(names)
            for choice in itertools.product(*choices):
                used = [j for j in choice if j >= 0]
                if len(set(used)) < len(used):
                    continue
                weight, updated = hypothesis.weight, {}
                for name, j in zip(names, choice, strict=True):
                    w, target = self._option(hypothesis.targets[name], position, R, j, p, rho)
                    weight *= w
                    updated[name] = target
                for j in set(range(len(number))) - set(used):
                    mean = np.array([*position[j], 0.0, 0.0])
                    v = targets.velocity_sigma_m_s**2
                    P = np.diag([sigma_m**2, sigma_m**2, v, v])
                    updated[int(number[j])] = Possible(t_s, first / rho, mean, P)
                following.append(Hypothesis(weight, updated))
        total = sum(h.weight for h in following)
        self.hypotheses = [Hypothesis(h.weight / total, h.targets) for h in following]
        self.undetected *= 1 - p

    def estimates(self):
        """(first_s, existence, mean, covariance) by the number of the first report."""
        found = {}
        for name in {n for h in self.hypotheses for n in h.targets}:
            parts = [(h.weight, h.targets[name]) for h in self.hypotheses if name in h.targets]
            weights = np.array([w * target.r for w, target in parts])
            existence = weights.sum()
            weights /= existence
            means = np.array([target.mean for _, target in parts])
            mean = weights @ means
            P = sum(
                w * (target.P + np.outer(target.mean - mean, target.mean - mean))
                for w, (_, target) in zip(weights, parts, strict=True)
            )
            found[name] = Possible(parts[0][1].first_s, existence, mean, P)
        return found

    def _predict(self, dt_s):
        targets, reporting = self.scene.targets, self.scene.reporting
        region, step_s = reporting.region, reporting.step_s
        F, Q, n = transition(dt_s, step_s, targets.accel_sigma_m_s2)
        s = math.exp(-n * step_s / targets.lifetime_s)
        born = targets.births_per_s * step_s * n / region.area
        self.undetected = self.undetected * s * float(targets.survival_map) ** n + born

        def moved(target):
            mean, P = F @ target.mean, F @ target.P @ F.T + Q
            x, y = norm(mean[0], math.sqrt(P[0, 0])), norm(mean[1], math.sqrt(P[1, 1]))
            inside = (x.cdf(region.x_max) - x.cdf(region.x_min)) * (
                y.cdf(region.y_max) - y.cdf(region.y_min)
            )
            lasts = s * float(targets.survival_map) ** n
            return Possible(target.first_s, target.r * lasts * inside, mean, P)

        self.hypotheses = [
            Hypothesis(h.weight, {name: moved(target) for name, target in h.targets.items()})
            for h in self.hypotheses
        ]

    def _option(self, target, position, R, j, p, rho):
        r = target.r
        if j < 0:
            missed = 1 - r * p
            return missed, target._replace(r=r * (1 - p) / missed)
        S = H @ target.P @ H.T + R
        K = target.P @ H.T @ np.linalg.inv(S)
        likelihood = multivariate_normal(H @ target.mean, S).pdf(position[j])
        mean = target.mean + K @ (position[j] - H @ target.mean)
        A = np.eye(4) - K @ H
        return r * p * likelihood / rho, Possible(
            target.first_s, 1.0, mean, A @ target.P @ A.T + K @ R @ K.T
        )


def exact_kernel(scene, **changed):
    """Make the compiled mixture without limits: nothing pruned, merged, gated or parted."""
    limits = {
        "gate": 1e6,
        "least_existence": 0.0,
        "least_weight": 0.0,
        "joined_existence": 0.0,
        "dependence": -1.0,
        "duplicates": -1.0,
        "recent": 8,
        "hypotheses": 10**6,
        "work": 10**12,
        "cluster_work": 10**12,
        "near": 1e9,
    }
    return kernel.Model({**kernel_model(scene, BernoulliSettings()), **limits, **changed})
