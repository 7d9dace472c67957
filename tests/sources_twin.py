"""The compiled search for sources again: plain Python, every sensor and source looked at, slow.

Signals come from `sensing.signal`, linear algebra from NumPy, neighbourhoods from distances: no
grid, no caches, nothing shared with the kernel but the rules.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from trackfield.localization.source_settings import SourceSettings
from trackfield.sensing import signal
from trackfield.sensing.signal import SignalModel

ALL, SOFT, SETTLED = 0, 1, 2
SIXTHS = np.array([[math.cos(k * math.pi / 3), math.sin(k * math.pi / 3)] for k in range(6)])


@dataclass(frozen=True)
class Source:
    place: np.ndarray
    log_factor: float
    leader: int


@dataclass
class Found:
    source: Source
    covariance: np.ndarray
    gain: float
    misfit: float
    good: bool
    whole: bool = False


@dataclass(frozen=True)
class Fit:
    sources: list[Source]
    covariances: list[np.ndarray]
    objective: float
    start: float
    chi2: float
    n: int

    @property
    def good(self) -> bool:
        return self.chi2 <= self.n + 4 * math.sqrt(2 * self.n)


class Twin:
    def __init__(self, model: SignalModel, sensors, values, settings: SourceSettings) -> None:
        heard = ~np.isnan(values)
        self.m, self.s = model, settings
        self.numbers = np.flatnonzero(heard)
        self.sensors, self.z = sensors[heard], values[heard]
        self.found: list[Found] = []
        self.refused = np.zeros(len(self.z), bool)
        self.free = model.sigma_factor > 0

    def run(self) -> list[Found]:
        loud = np.flatnonzero(self.z >= self.s.leader_sigmas * self.m.sigma)
        for k in range(self.s.rounds):
            added, asked = self.ask(loud, first=k == 0)
            if not asked:
                break
            if added:
                self.settle()
        if self.prune():
            self.polish(elsewhere=False)
        return self.found

    def suspects(self) -> list[int]:
        e = self.excess()
        near = np.zeros(len(self.z), bool)
        for one in self.found:
            near |= self.within(one.source.place, self.s.fit_radius_m)
        odd = (near & (abs(e) >= self.s.outlier_sigmas)) | (
            self.refused & (e >= self.s.leader_sigmas)
        )
        return self.numbers[odd].tolist()

    # What the sensors say beyond the sources

    def within(self, place, radius_m):
        return ((self.sensors - place) ** 2).sum(1) <= radius_m**2

    def misfit(self, sources, sensors=slice(None)):
        """Residuals and variances at sensors."""
        targets = np.array([s.place for s in sources]).reshape(-1, 2)
        factors = np.exp([s.log_factor for s in sources])
        place, z = self.sensors[sensors], self.z[sensors]
        r = z - signal.expected(self.m, place, targets=targets, factors=factors)
        r[(z >= self.m.saturation) & (r < 0)] = 0.0
        return r, signal.variance(self.m, place, targets=targets, factors=factors)

    def excess(self):
        r, v = self.misfit([one.source for one in self.found])
        return r / np.sqrt(v)

    # Leaders

    def ask(self, loud, *, first):
        e = self.excess()
        keys = self.z if first else e
        order = [i for i in loud if not self.refused[i]]
        order = [i for i in order if (self.loudest(i) if first else e[i] >= self.s.leader_sigmas)]
        added = asked = 0
        for i in sorted(order, key=lambda i: (-keys[i], i)):
            e = self.excess()
            if e[i] < self.s.leader_sigmas or (first and e[i] < 0.5 * self.z[i] / self.m.sigma):
                continue
            near = self.within(self.sensors[i], self.s.leader_radius_m) & ~self.refused
            if any((e[j], -j) > (e[i], -i) for j in np.flatnonzero(near)):
                continue
            asked += 1
            if self.lead(i, first=first):
                added += 1
            else:
                self.refused[i] = True
        return added, asked

    def loudest(self, i):
        near = np.flatnonzero(self.within(self.sensors[i], self.s.leader_radius_m))
        return all((self.z[j], -j) <= (self.z[i], -i) for j in near)

    def lead(self, i, *, first):
        group = self.neighbours(self.sensors[i], self.s.group - 1)
        known = [one.source for one in group]
        window = self.window([self.sensors[i], *(s.place for s in known)])
        fitter = self.fitter(window, group)
        before = fitter.judge(known)
        start = [*known, self.start_at(i)]
        best = fitter.run(start, ALL)
        if not best.good:
            best = better(best, fitter.run(start, SOFT))
        if not best.good and not (first and best.n >= 30 and self.worthy(best, before)):
            for turn in SIXTHS:
                place = self.sensors[i] + 0.5 * self.s.leader_radius_m * turn
                best = better(best, fitter.run([*known, Source(place, 0.0, i)], ALL, 10))
            best = better(best, fitter.run(best.sources, ALL))
        if not self.worthy(best, before) or not self.usable(best):
            return False
        self.add_last(best, group, best.objective - before.objective)
        return True

    def worthy(self, fit, before):
        return fit.objective - before.objective > self.s.gain or fit.chi2 < 0.5 * before.chi2

    def start_at(self, i):
        r, _ = self.misfit([one.source for one in self.found])
        near = self.within(self.sensors[i], self.s.leader_radius_m) & ~self.refused
        mass = np.where(near, np.maximum(r, 0.0), 0.0)
        return Source(mass @ self.sensors / mass.sum(), 0.0, i)

    # Fits of groups

    def neighbours(self, place, most, but=None):
        near = [
            (math.hypot(*(one.source.place - place)), k, one)
            for k, one in enumerate(self.found)
            if one is not but
        ]
        near = [each for each in near if each[0] <= self.s.group_radius_m]
        return [one for _, _, one in sorted(near, key=lambda each: each[:2])[:most]]

    def window(self, places):
        return np.any([self.within(p, self.s.fit_radius_m) for p in places], axis=0)

    def fitter(self, window, group):
        others = [one.source for one in self.found if not any(one is g for g in group)]
        return Fitter(self, np.flatnonzero(window), others)

    def group(self, one):
        return [one, *self.neighbours(one.source.place, self.s.group - 1, but=one)]

    def opened(self, group):
        now = [one.source for one in group]
        return now, self.fitter(self.window([s.place for s in now]), group)

    def usable(self, fit):
        reach = self.m.max_range_m + 4 * self.m.placement_sigma_m
        return all(
            math.hypot(*(s.place - self.sensors[s.leader])) <= reach for s in fit.sources
        ) and all(np.isfinite(c).all() for c in fit.covariances)

    def put(self, one, fit, k):
        one.source, one.covariance = fit.sources[k], fit.covariances[k]
        one.misfit, one.good = fit.chi2 / max(fit.n, 1), fit.good

    def add_last(self, fit, group, gain):
        fresh = Found(fit.sources[-1], fit.covariances[-1], gain, misfit=0.0, good=False)
        for k, one in enumerate([*group, fresh]):
            self.put(one, fit, k)
        self.found.append(fresh)

    def settle(self):
        self.polish(elsewhere=False)
        self.polish(elsewhere=True)
        if self.split():
            self.polish(elsewhere=False)

    def polish(self, *, elsewhere):
        for one in self.found:
            self.refit(one, elsewhere=elsewhere)

    def refit(self, one, *, elsewhere):
        group = self.group(one)
        now, fitter = self.opened(group)
        fit = fitter.run(now, SETTLED)
        before = fit.start
        if not fit.good:
            fit = better(fit, fitter.run(now, SOFT))
        if not fit.good and elsewhere:
            at, rest = fit.sources[0], fit.sources[1:]
            for turn in SIXTHS:
                moved = replace(at, place=at.place + self.s.leader_radius_m * turn)
                fit = better(fit, fitter.run([moved, *rest], ALL, 10))
            fit = better(fit, fitter.run(fit.sources, SETTLED))
        if fit.objective < before - 1e-6 or not self.usable(fit):
            return
        self.put(one, fit, 0)
        for k, other in enumerate(group[1:], 1):
            other.source = fit.sources[k]

    def split(self):
        if not self.free:
            return False
        halved = [self.halve(one) for one in self.found if not one.whole]
        return any(halved)

    def halve(self, one):
        one.whole = True
        group = self.group(one)[: max(self.s.group - 1, 1)]
        now, fitter = self.opened(group)
        before = fitter.judge(now).objective
        best = None
        for turn in SIXTHS[:3]:
            arm = 0.5 * self.s.leader_radius_m * turn
            weak = now[0].log_factor - math.log(2.0)
            first = replace(now[0], place=now[0].place + arm, log_factor=weak)
            second = replace(now[0], place=now[0].place - arm, log_factor=weak)
            fit = fitter.run([first, *now[1:], second], ALL, 10)
            best = fit if best is None else better(best, fit)
        best = better(best, fitter.run(best.sources, ALL))
        if best.objective - before <= self.s.split_gain or not self.usable(best):
            return False
        self.add_last(best, group, best.objective - before)
        return True

    def prune(self):
        least = min(self.s.gain, self.s.split_gain)
        any_gone = False
        for one in self.found[::-1]:
            group = self.group(one)
            now, fitter = self.opened(group)
            rest = fitter.run(now[1:], SETTLED) if now[1:] else fitter.judge([])
            one.gain = fitter.judge(now).objective - rest.objective
            if one.gain > least:
                continue
            any_gone = True
            self.found = [other for other in self.found if other is not one]
            if now[1:] and self.usable(rest):
                for k, other in enumerate(group[1:]):
                    self.put(other, rest, k)
        return any_gone


def better(best, other):
    return other if other.objective > best.objective else best


class Fitter:
    """A joint fit to a window of sensors, beside sources that stay as they are."""

    def __init__(self, twin: Twin, window, others) -> None:
        self.t, self.window, self.others = twin, window, others
        self.d = 3 if twin.free else 2

    def misfit(self, sources):
        return self.t.misfit([*self.others, *sources], self.window)

    def slopes(self, sources, r):
        """J (n, sources * d) of the readings."""
        every = [*self.others, *sources]
        targets = np.array([s.place for s in every])
        factors = np.exp([s.log_factor for s in every])
        place = self.t.sensors[self.window]
        J = signal.jacobian(self.t.m, place, targets=targets, factors=factors)
        J = J[:, len(self.others) :]
        if self.d == 3:
            alone = np.stack(
                [
                    signal.expected(self.t.m, place, targets=p[None]) * f
                    for p, f in zip(targets, factors, strict=True)
                ],
                1,
            )
            if self.t.m.combination == "max":
                alone *= np.eye(len(every))[alone.argmax(1)]
            J = np.concatenate([J, alone[:, len(self.others) :, None]], 2)
        J = J.reshape(len(place), self.d * len(sources))
        J[(self.t.z[self.window] >= self.t.m.saturation) & (r == 0)] = 0.0
        return J

    def priors(self, sources):
        """Deviations from what is believed before, and their precisions."""
        near = 1 / self.t.m.max_range_m**2
        off, weight = [], []
        for s in sources:
            off.extend(s.place - self.t.sensors[s.leader])
            weight.extend([near, near])
            if self.d == 3:
                off.append(s.log_factor)
                weight.append(1 / self.t.m.sigma_factor**2)
        return np.array(off), np.array(weight)

    def objective(self, sources):
        r, v = self.misfit(sources)
        c2 = self.t.s.outlier_sigmas**2
        off, weight = self.priors(sources)
        mixture = np.logaddexp(-0.5 * r**2 / v, -0.5 * c2)
        return float((mixture - 0.5 * np.log(v)).sum() - 0.5 * (weight * off**2).sum())

    def judge(self, sources, covariances=(), start=math.nan):
        r, v = self.misfit(sources)
        return Fit(
            list(sources),
            list(covariances),
            self.objective(sources),
            start,
            float((r**2 / v).sum()),
            len(r),
        )

    def weights(self, r, v, phase):
        e2, c2 = r**2 / v, self.t.s.outlier_sigmas**2
        if phase == SOFT:
            return np.minimum(1.0, np.sqrt(c2 / np.maximum(e2, 1e-300))) / v
        if phase == SETTLED:
            return 1 / (1 + np.exp(np.minimum(0.5 * (e2 - c2), 700.0))) / v
        return 1 / v

    def few_are_off(self, r, v):
        e, c = abs(r) / np.sqrt(v), self.t.s.outlier_sigmas
        return (e > c - 1).any() and (e > c).sum() <= 0.5 * len(e)

    def normal(self, sources, w):
        r, _ = self.misfit(sources)
        J = self.slopes(sources, r)
        off, weight = self.priors(sources)
        return J.T @ (w[:, None] * J) + np.diag(weight), J.T @ (w * r) - weight * off

    def moved(self, sources, step):
        out = []
        for s, p in zip(sources, step.reshape(len(sources), self.d), strict=True):
            share = min(1.0, self.t.s.max_step_m / max(math.hypot(p[0], p[1]), 1e-300))
            if self.d == 3:
                share = min(share, 0.5 / max(abs(p[2]), 1e-300))
            out.append(
                replace(
                    s,
                    place=s.place + share * p[:2],
                    log_factor=s.log_factor + share * (p[2] if self.d == 3 else 0.0),
                )
            )
        return out

    def cost(self, sources, w):
        r, _ = self.misfit(sources)
        off, weight = self.priors(sources)
        return (w * r**2).sum() + (weight * off**2).sum()

    def run(self, start, trust, iterations=30):
        at, phase, damping, soft = list(start), trust, 0.0, 0
        w = self.weights(*self.misfit(at), phase)
        for _ in range(iterations):
            A, g = self.normal(at, w)
            step = np.linalg.solve(A + np.diag((damping + 1e-12) * np.diag(A)), g)
            ended = 0.5 * step @ g < 1e-6 and damping < 1.0
            if ended or (phase == SOFT and soft >= (12 if trust == SOFT else 4)):
                if phase == SETTLED or (phase == ALL and not self.few_are_off(*self.misfit(at))):
                    break
                phase, damping, soft = phase + 1, 0.0, 0
                w = self.weights(*self.misfit(at), phase)
                continue
            soft += phase == SOFT
            trial = self.moved(at, step)
            if self.cost(trial, w) <= self.cost(at, w) * (1 + 1e-12):
                at = trial
                w = self.weights(*self.misfit(at), phase)
                damping = 0.1 * damping if damping > 1e-4 else 0.0
            else:
                damping = max(4 * damping, 1e-2)
        A, _ = self.normal(at, w)
        P = np.linalg.inv(A)
        blocks = [P[k : k + 2, k : k + 2] for k in range(0, len(P), self.d)]
        return self.judge(at, blocks, self.objective(start))
