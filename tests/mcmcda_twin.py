"""The sampler's twin: every track and partition listed, every proposal with its probability.

Plain Python, slow, nothing incremental: densities of reports are dense Gaussians, and how probable
the way back is gets looked up among the proposals of the other partition, so no Hastings term
stands here that could be wrong in the same way.
"""

from __future__ import annotations

import math
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr
from scipy.stats import multivariate_normal

from trackfield._core._mcmcda import Sampler
from trackfield.association.partition import Life, Window
from trackfield.raster import Region

MOVES = ("birth", "death", "split", "merge", "extension", "reduction", "update", "switch")
LEAST_WEIGHT, LEAST_STOP, LEAST_PAIR, NOWHERE = 1e-4, 1e-2, 1e-9, 60.0


class Route(NamedTuple):
    """A proposal: `key` is the same for the way back, `q` its probability, `to` the partition."""

    key: tuple
    q: float
    to: frozenset


class Problem:
    """A window with settings of the chain, small enough to list everything."""

    def __init__(self, window: Window, *, informed: bool, **changed) -> None:
        self.window, self.informed = window, informed
        region = window.life.region
        self.settings = {
            "velocity_variance": window.life.velocity_sigma_m_s**2,
            "accel_variance": window.life.accel_sigma_m_s2**2,
            "step": window.life.step_s,
            "max_speed": 1.8,
            "margin": 1.0,
            "stop": 0.15,
            "gaps": [0.6, 0.4],
            "moves": [1.0, 1.2, 0.8, 1.1, 0.9, 1.0, 1.3, 0.7],
            "informed": informed,
            "marginal_death": window.life.log_death is None,
            "log_death": window.life.log_death or 0.0,
            "region": [-math.inf, -math.inf, math.inf, math.inf] if region is None else [*region],
            "frozen": 0,
            **changed,
        }
        self.n, self.slots = len(window), window.t_s.size
        self.slot = window.slot.tolist()
        self.density = lru_cache(None)(self._density)
        self.score = lru_cache(None)(self._score)

    def sampler(self, owner=None, random=(1, 2, 3, 4)) -> Sampler:
        w = self.window
        columns = np.column_stack([w.position, w.covariance, w.log_birth, w.log_false])
        start = np.full(self.n, -1, np.int32) if owner is None else np.array(owner, np.int32)
        return Sampler(
            self.settings, w.slot, columns, w.t_s, w.survival, w.p_detection, start, list(random)
        )

    # What can be --------------------------------------------------------------------------------

    def linked(self, i: int, j: int) -> bool:
        w = self.window
        d = self.slot[j] - self.slot[i]
        if not 1 <= d <= len(self.settings["gaps"]):
            return False
        width = np.sqrt((w.covariance[[i, j], 0] + w.covariance[[i, j], 2]) / 2).sum()
        far = self.settings["max_speed"] * (w.t_s[self.slot[j]] - w.t_s[self.slot[i]])
        apart = float(np.hypot(*(w.position[j] - w.position[i])))
        return apart <= far + self.settings["margin"] * width

    @cached_property
    def followers(self) -> list[list[int]]:
        return [[j for j in range(self.n) if self.linked(i, j)] for i in range(self.n)]

    @cached_property
    def tracks(self) -> list[tuple[int, ...]]:
        found = []

        def grow(track):
            if len(track) > 1:
                found.append(track)
            for j in self.followers[track[-1]]:
                grow((*track, j))

        for i in range(self.n):
            grow((i,))
        return found

    @cached_property
    def partitions(self) -> list[frozenset]:
        found = []

        def add(k, used, chosen):
            found.append(frozenset(chosen))
            for m in range(k, len(self.tracks)):
                if not used & set(self.tracks[m]):
                    add(m + 1, used | set(self.tracks[m]), [*chosen, self.tracks[m]])

        add(0, set(), [])
        return found

    @cached_property
    def posterior(self) -> np.ndarray:
        logs = np.array([sum(map(self.score, w)) for w in self.partitions])
        p = np.exp(logs - logs.max())
        return p / p.sum()

    def owners(self, partitions) -> np.ndarray:
        """Partitions as the sampler writes them, (P, n)."""
        out = np.full((len(partitions), self.n), -1, np.int16)
        for row, partition in zip(out, partitions, strict=True):
            for k, track in enumerate(sorted(partition)):
                row[list(track)] = k
        return out

    def visits(self, trace: np.ndarray) -> np.ndarray:
        """Number of the partition in each row of a sampler's trace; each must be one of ours."""
        base = 1 + self.n // 2
        powers = np.int64(base) ** np.arange(self.n)
        codes = (self.owners(self.partitions).astype(np.int64) + 1) @ powers
        order = np.argsort(codes)
        seen = (trace.astype(np.int64) + 1) @ powers
        at = order[np.searchsorted(codes[order], seen).clip(max=len(order) - 1)]
        assert (codes[at] == seen).all(), "the chain went to a partition that cannot be"
        return at

    # The posterior ------------------------------------------------------------------------------

    def _joint(self, track, ahead=None):
        """Mean and covariance of the positions reported, after the first, and of one later slot."""
        w, life = self.window, self.window.life
        t = [w.t_s[self.slot[i]] - w.t_s[self.slot[track[0]]] for i in track[1:]]
        t += [] if ahead is None else [w.t_s[ahead] - w.t_s[self.slot[track[0]]]]
        R = [w.covariance[i][[[0, 1], [1, 2]]] for i in track]
        steps = round(max(t)) if t else 0
        C = np.zeros((2 * len(t), 2 * len(t)))
        for a, ta in enumerate(t):
            for b, tb in enumerate(t):
                pushed = sum(
                    (ta - k - 0.5) * (tb - k - 0.5) for k in range(steps) if k < min(ta, tb)
                )
                moved = life.velocity_sigma_m_s**2 * ta * tb + life.accel_sigma_m_s2**2 * pushed
                block = R[0] + moved * np.eye(2)
                if a == b and a + 1 < len(R):
                    block = block + R[a + 1]
                C[2 * a : 2 * a + 2, 2 * b : 2 * b + 2] = block
        return np.tile(w.position[track[0]], len(t)), C

    def _density(self, track) -> float:
        """Log density of a track's reports after the first, given the first."""
        if len(track) == 1:
            return 0.0
        mean, C = self._joint(track)
        return float(
            multivariate_normal.logpdf(self.window.position[list(track[1:])].ravel(), mean, C)
        )

    def ahead(self, track, slot) -> tuple[np.ndarray, np.ndarray]:
        """Mean and variances of the position in a slot after the track."""
        mean, C = self._joint(track, slot)
        z = self.window.position[list(track[1:])].ravel()
        m = z.size
        gain = np.linalg.solve(C[:m, :m], C[:m, m:]).T if m else np.zeros((2, 0))
        return mean[m:] + gain @ (z - mean[:m]), np.diag(C[m:, m:] - gain @ C[:m, m:])

    def constant(self, i, j) -> float:
        """Log posterior of going from report i to j but for the density of j."""
        w = self.window
        between = range(self.slot[i] + 1, self.slot[j])
        return (
            sum(math.log(1 - w.p_detection[t, i]) for t in between)
            + sum(math.log(w.survival[t]) for t in range(self.slot[i] + 1, self.slot[j] + 1))
            + math.log(w.p_detection[self.slot[j], j])
            - w.log_false[j]
        )

    def birth(self, i) -> float:
        w = self.window
        return w.log_birth[i] + math.log(w.p_detection[self.slot[i], i]) - w.log_false[i]

    def silence(self, track, *, bordered) -> float:
        """Probability that a track is not seen after its last report: ended sometime, or not."""
        w, i = self.window, track[-1]
        after = range(self.slot[i] + 1, self.slots)
        total, alive = 0.0, 1.0
        for t in after:
            stay = w.survival[t]
            if bordered and w.life.region is not None:
                mean, variance = self.ahead(track, t)
                low, high = np.array(w.life.region[:2]), np.array(w.life.region[2:])
                sigma = np.sqrt(variance)
                stay *= float((ndtr((high - mean) / sigma) - ndtr((low - mean) / sigma)).prod())
            total += alive * (1 - stay)
            alive *= stay * (1 - w.p_detection[t, i])
        return total + alive

    def _score(self, track) -> float:
        steps = sum(self.constant(i, j) for i, j in pairwise(track))
        if self.settings["marginal_death"]:
            end = math.log(self.silence(track, bordered=True))
        else:
            end = self.settings["log_death"] if self.slot[track[-1]] < self.slots - 1 else 0.0
        return self.birth(track[0]) + steps + self.density(track) + end

    # Proposals ----------------------------------------------------------------------------------

    def free(self, partition) -> set[int]:
        taken = {i for track in partition for i in track}
        frozen = self.settings["frozen"]
        return {i for i in range(self.n) if i not in taken and self.slot[i] >= frozen}

    def odds(self, track, j) -> float:
        """Posterior odds that report j brings at the end of a track."""
        density = self.density((*track, j)) - self.density(track)
        return math.exp(self.constant(track[-1], j) + density)

    def distance2(self, track, j) -> float:
        w = self.window
        mean, C = self._joint((*track, j))
        z = w.position[[*track[1:], j]].ravel()
        m = z.size - 2
        gain = np.linalg.solve(C[:m, :m], C[:m, m:]).T if m else np.zeros((2, 0))
        residual = z[m:] - mean[m:] - gain @ (z[:m] - mean[:m])
        return float(residual @ np.linalg.solve(C[m:, m:] - gain @ C[:m, m:], residual))

    def weights(self, track, free) -> dict[int, float]:
        """Weights of what may follow a track."""
        return {
            j: LEAST_WEIGHT + (self.odds(track, j) if self.distance2(track, j) < NOWHERE else 0.0)
            for j in self.followers[track[-1]]
            if j in free
        }

    def picks(self, track, free) -> dict[int | None, float]:
        """Probability of what the suffix process does next; None: it stops."""
        if self.informed:
            weights = self.weights(track, free)
            stop = max(self.silence(track[-1:], bordered=False), LEAST_STOP)
            total = stop + sum(weights.values())
            return {None: stop / total, **{j: w / total for j, w in weights.items()}}
        gamma = self.settings["stop"]
        out: dict[int | None, float] = {None: gamma}
        for j, q in self.gaps(track[-1], free).items():
            out[j] = out.get(j, 0.0) + (1 - gamma) * q
        return out

    def gaps(self, i, free) -> dict[int | None, float]:
        """Uniform pick: a gap by zeta, then any free report there; None where there is none."""
        out: dict[int | None, float] = {None: 0.0}
        for d, zeta in enumerate(self.settings["gaps"], 1):
            there = [j for j in self.followers[i] if j in free and self.slot[j] - self.slot[i] == d]
            if not there:
                out[None] += zeta
            for j in there:
                out[j] = zeta / len(there)
        return out

    def forced(self, track, free) -> dict[int, float]:
        """Probability of what follows when something must."""
        if self.informed:
            weights = self.weights(track, free)
            return {j: w / sum(weights.values()) for j, w in weights.items()}
        picks = self.gaps(track[-1], free)
        del picks[None]
        return picks

    def suffixes(self, track, free):
        """Every way in which the suffix process goes on from a track, with its probability."""
        for j, q in self.picks(track, free).items():
            if j is None:
                yield track, q
            else:
                for whole, more in self.suffixes((*track, j), free):
                    yield whole, q * more

    @cached_property
    def pair_weights(self) -> dict[tuple[int, int], float]:
        backwards = [0.0] * self.n
        pairs = {(i, j): self.odds((i,), j) for i in range(self.n) for j in self.followers[i]}
        for (_, j), odds in pairs.items():
            backwards[j] += odds
        out = {}
        for (i, j), odds in pairs.items():
            further = self.silence((j,), bordered=False)
            further += sum(self.odds((i, j), k) for k in self.followers[j])
            out[i, j] = LEAST_PAIR + math.exp(self.birth(i)) * odds * further / (1 + backwards[i])
        return out

    def pairs(self, free) -> dict[tuple[int, int], float]:
        """Probability of the first two reports of a birth."""
        if self.informed:
            open_pairs = {p: w for p, w in self.pair_weights.items() if free >= set(p)}
            return {p: w / sum(open_pairs.values()) for p, w in open_pairs.items()}
        out = {}
        first_slots = range(self.settings["frozen"], self.slots - 1)
        for t in first_slots:
            for d, zeta in enumerate(self.settings["gaps"], 1):
                ways = {
                    i: there
                    for i in free
                    if self.slot[i] == t
                    and (
                        there := [
                            j for j in self.followers[i] if j in free and self.slot[j] == t + d
                        ]
                    )
                }
                for i, there in ways.items():
                    for j in there:
                        out[i, j] = zeta / len(first_slots) / len(ways) / len(there)
        return out

    def fixed(self, track) -> int:
        return sum(self.slot[i] < self.settings["frozen"] for i in track)

    def routes(self, w):
        """Every proposal from a partition but for those that change nothing."""
        allowed = {
            m: weight
            for m, weight in zip(MOVES, self.settings["moves"], strict=True)
            if len(w) > 1 or m == "birth" or (len(w) == 1 and m not in ("merge", "switch"))
        }
        total = sum(allowed.values())
        for move, weight in allowed.items():
            for key, q, to in getattr(self, "_" + move)(w):
                yield Route(key, weight / total * q, to)

    def _birth(self, w):
        free = self.free(w)
        for pair, q in self.pairs(free).items():
            for track, more in self.suffixes(pair, free):
                yield ("birth", track), q * more, w | {track}

    def _death(self, w):
        for track in w:
            if not self.fixed(track):
                yield ("birth", track), 1 / len(w), w - {track}

    def _split(self, w):
        cuts = [(t, i) for t in w for i in range(max(2, self.fixed(t)), len(t) - 1)]
        for track, i in cuts:
            parts = {track[:i], track[i:]}
            yield ("split", frozenset(parts)), 1 / len(cuts), w - {track} | parts

    def _merge(self, w):
        ways = [
            (a, b) for a in w for b in w if b[0] in self.followers[a[-1]] and not self.fixed(b[:1])
        ]
        for a, b in ways:
            yield ("split", frozenset((a, b))), 1 / len(ways), w - {a, b} | {a + b}

    def earlier(self, track, free) -> dict[int, float]:
        """Probability of what goes before a track."""
        weights = {
            h: LEAST_PAIR
            + math.exp(self.birth(h))
            * self.odds((h,), track[0])
            * self.odds((h, track[0]), track[1])
            for h in free
            if track[0] in self.followers[h]
        }
        return {h: x / sum(weights.values()) for h, x in weights.items()}

    def _extension(self, w):
        free = self.free(w)
        at_end = 0.5 if self.informed else 1.0
        for track in w:
            for j, q in self.forced(track, free).items():
                for longer, more in self.suffixes((*track, j), free):
                    key = ("extension", track, longer)
                    yield key, at_end * q * more / len(w), w - {track} | {longer}
            if self.informed and not self.fixed(track):
                for h, q in self.earlier(track, free).items():
                    longer = (h, *track)
                    yield ("before", track, longer), 0.5 * q / len(w), w - {track} | {longer}

    def _reduction(self, w):
        at_end = 0.5 if self.informed else 1.0
        for track in w:
            least = max(2, self.fixed(track))
            for left in range(least, len(track)):
                shorter = track[:left]
                q = at_end / len(w) / (len(track) - least)
                yield ("extension", shorter, track), q, w - {track} | {shorter}
            if self.informed and not self.fixed(track) and len(track) > 2:
                shorter = track[1:]
                yield ("before", shorter, track), 0.5 / len(w), w - {track} | {shorter}

    def _update(self, w):
        free = self.free(w)
        for track in w:
            least = max(1, self.fixed(track))
            for left in range(least, len(track) + 1):
                q = 1 / len(w) / (len(track) - least + 1)
                for other, more in self.suffixes(track[:left], free | set(track[left:])):
                    if len(other) > 1 and other != track:
                        key = ("update", left, frozenset((track, other)))
                        yield key, q * more, w - {track} | {other}

    def _switch(self, w):
        ways = []
        tracks = sorted(w)
        for x, a in enumerate(tracks):
            for b in tracks[x + 1 :]:
                for i in range(1, len(a)):
                    for j in range(1, len(b)):
                        crossed = (
                            b[j] in self.followers[a[i - 1]] and a[i] in self.followers[b[j - 1]]
                        )
                        if crossed and not self.fixed((a[i],)) and not self.fixed((b[j],)):
                            ways.append((a, b, {a[:i] + b[j:], b[:j] + a[i:]}))
        for a, b, parts in ways:
            key = ("switch", frozenset((frozenset((a, b)), frozenset(parts))))
            yield key, 1 / len(ways), w - {a, b} | parts

    def transitions(self) -> np.ndarray:
        """Probability to go from each partition to each, (P, P): Metropolis and Hastings."""
        number = {w: k for k, w in enumerate(self.partitions)}
        routes = [{r.key: r for r in self.routes(w)} for w in self.partitions]
        P = np.zeros((len(number), len(number)))
        for here, ways in enumerate(routes):
            for route in ways.values():
                there = number[route.to]
                back = routes[there][route.key].q
                ratio = self.posterior[there] * back / (self.posterior[here] * route.q)
                P[here, there] += route.q * min(1.0, ratio)
            P[here, here] = 1.0 - P[here].sum()
        return P


def window(seed, *, slots=5, targets=2, false=4, round_reports=True, region=None, log_death=None):
    """A small window: targets crossing a room of 6 m, reports of .55 m, every number different."""
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(targets):
        x, v = rng.uniform(1, 5, 2), rng.normal(0, 0.6, 2)
        rows += [
            (t, *(x + v * t + 0.4 * rng.normal(size=2))) for t in range(slots) if rng.random() < 0.7
        ]
    rows += [(rng.integers(slots), *rng.uniform(0, 6, 2)) for _ in range(false)]
    rows = np.array(sorted(rows))
    n = len(rows)
    variance = rng.uniform(0.2, 0.4, n)
    covariance = np.column_stack([variance, np.zeros(n), variance])
    if not round_reports:
        covariance = np.column_stack(
            [variance, rng.uniform(-0.1, 0.1, n), rng.uniform(0.2, 0.4, n)]
        )
    return Window(
        t_s=np.arange(slots, dtype=float),
        survival=rng.uniform(0.85, 0.95, slots),
        slot=rows[:, 0].astype(np.int32),
        position=np.ascontiguousarray(rows[:, 1:]),
        covariance=covariance,
        log_birth=np.log(0.02 * rng.uniform(0.5, 2.0, n)),
        log_false=np.log(0.06 * rng.uniform(0.5, 2.0, n)),
        p_detection=rng.uniform(0.4, 0.8, (slots, n)),
        life=Life(0.3, 1.0, 1.0, region, log_death),
    )


ROOM = Region(0.0, 0.0, 6.0, 6.0)
