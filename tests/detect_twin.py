"""Track-before-detect in plain NumPy, one idea a function, slow: the compiled filter's twin.

It takes the same settings, map and chance as `trackfield._core._detect.Filter`, and is written from
the description of the method, with dense matrices where the kernel has sparse lists.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

GOLDEN = np.uint64(0x9E3779B97F4A7C15)
MULTIPLIERS = (np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB))


def scrambled(z):
    """Splitmix64's finaliser."""
    z = np.asarray(z, np.uint64)
    with np.errstate(over="ignore"):
        z = (z ^ (z >> np.uint64(30))) * MULTIPLIERS[0]
        z = (z ^ (z >> np.uint64(27))) * MULTIPLIERS[1]
    return z ^ (z >> np.uint64(31))


class Chance:
    """The sequence of a seed, read at any place after what was used."""

    def __init__(self, seed):
        with np.errstate(over="ignore"):
            self.key = scrambled(np.uint64(seed) + GOLDEN)
        self.used = 0

    def bits(self, places):
        with np.errstate(over="ignore"):
            n = np.asarray(places, np.uint64) + np.uint64(self.used + 1)
            return scrambled(self.key + n * GOLDEN)

    def uniform(self, places):
        return (self.bits(places) >> np.uint64(11)).astype(float) * 2.0**-53

    def normal(self, places):
        b = self.bits(places)
        parts = sum(((b >> np.uint64(16 * i)) & np.uint64(0xFFFF)).astype(float) for i in range(4))
        return (parts - 131070.0) / (65536.0 / math.sqrt(3.0))


class Member:
    """A possible target: `x` (n, 4), `here` (n,), existence, label."""

    def __init__(self, track, x, existence):
        self.track, self.x, self.existence = track, x, existence
        self.here = np.ones(len(x), bool)
        self.confirmed, self.mean, self.cover = False, np.zeros(4), None


class Group:
    """Members with one particle index, and its weights."""

    def __init__(self, members, weight):
        self.members, self.weight = members, weight

    @property
    def joint(self):
        return len(self.members) > 1


class DetectTwin:
    """The filter; `settings` and `sensors` (n, 3) p, q, delivery as for the kernel."""

    def __init__(self, settings, grid, dense, sensors, seed):
        self.s, self.dense, self.sensors = settings, dense, sensors
        self.x_min, self.y_min, self.cell, self.rows, self.columns = grid
        self.chance, self.groups, self.next_track = Chance(seed), [], 1
        self.dead = np.full(len(sensors), settings["dead"])
        self.stuck = np.full(len(sensors), settings["stuck"])
        self.rates = np.zeros((2, 2))  # p and q: hits, tries
        stride = settings["birth_stride"]
        self.width = stride * self.cell
        self.shape = (-(-self.rows // stride), -(-self.columns // stride))
        i, j = np.indices(self.shape)
        self.places = np.column_stack([j.ravel() + 0.5, i.ravel() + 0.5]) * self.width
        self.places += [self.x_min, self.y_min]
        at = [
            np.minimum(k * stride + stride // 2, n - 1)
            for k, n in ((i, self.rows), (j, self.columns))
        ]
        self.place_cell = (at[0] * self.columns + at[1]).ravel()
        sigma = settings["velocity_sigma"]
        steps = np.arange(-2, 3) * 0.8 * sigma
        self.velocity = np.array([(vx, vy) for vy in steps for vx in steps])
        prior = np.exp(-0.5 * (self.velocity**2).sum(1) / sigma**2)
        self.prior = prior / prior.sum()
        self.unseen = np.outer(self.prior, np.ones(len(self.places))) / len(self.places)
        self.unseen *= settings["initial_count"]

    # One step -----------------------------------------------------------------------------------

    def step(self, value, dt):
        self.listen(value)
        for group in self.groups:
            self.move(group, dt)
        self.drop()
        self.background(None)
        self.doubt(value)
        self.move_unseen(dt)
        self.single_out()
        self.regroup()
        self.groups.sort(key=lambda g: -round_half(1e6 * max(m.existence for m in g.members)))
        for group in self.groups:
            self.background(group)
            (self.update_joint if group.joint else self.update_alone)(group)
            self.cover(group)
        self.drop()
        self.background(None)
        self.unseen *= self.ratio()[self.place_cell]
        self.learn(value, dt)
        for group in self.groups:
            self.summarize(group)
            for m in group.members:
                m.confirmed |= m.existence > self.s["confirm"]

    def cells(self, x):
        j = np.floor((x[:, 0] - self.x_min) / self.cell)
        i = np.floor((x[:, 1] - self.y_min) / self.cell)
        inside = (j >= 0) & (i >= 0) & (j < self.columns) & (i < self.rows)
        return np.where(inside, i * self.columns + j, -1).astype(int)

    def spend(self, n):
        self.chance.used += n

    # Motion -------------------------------------------------------------------------------------

    def move(self, group, dt):
        s, n = self.s, len(group.weight)
        sigma, turns = math.sqrt(s["accel_density"] * dt), 1 - math.exp(-dt * s["turn_rate"])
        survival, four = math.exp(-dt / s["lifetime"]), 4 * np.arange(n)
        for m in group.members:
            m.mean[:2] += dt * m.mean[2:]
            scale = np.where(self.chance.uniform(four) < turns, s["turn_sigma"], sigma)
            u = np.column_stack([self.chance.normal(four + 1), self.chance.normal(four + 2)])
            u *= scale[:, None]
            m.x = np.column_stack([m.x[:, :2] + dt * (m.x[:, 2:] + 0.5 * u), m.x[:, 2:] + u])
            m.here &= self.cells(m.x) >= 0
            if group.joint:
                m.here &= self.chance.uniform(four + 3) < survival
            self.spend(4 * n)
        if group.joint:
            self.count(group)
        else:
            (m,) = group.members
            m.existence *= survival * group.weight[m.here].sum()
            if m.existence >= s["drop"] and not m.here.all():
                self.marginal(group, m)
                group.weight = np.full(n, 1.0 / n)
        self.cover(group)

    def count(self, group):
        for m in group.members:
            m.existence = group.weight[m.here].sum()

    def systematic(self, w, n, u):
        sums = np.cumsum(w)
        return np.minimum(
            np.searchsorted(sums, (np.arange(n) + u) / n * sums[-1], side="right"), len(w) - 1
        )

    def marginal(self, group, m):
        index = self.systematic(group.weight * m.here, len(m.x), self.chance.uniform(0))
        self.spend(1)
        m.x, m.here = m.x[index], m.here[index]

    def drop(self):
        for group in self.groups:
            joint = group.joint
            group.members = [m for m in group.members if m.existence >= self.s["drop"]]
            if joint and len(group.members) == 1:
                self.marginal(group, group.members[0])
                group.weight = np.full_like(group.weight, 1.0 / len(group.weight))
        self.groups = [g for g in self.groups if g.members]

    def cover(self, group):
        for m in group.members:
            w = group.weight * m.here
            total = w.sum()
            m.cover = np.zeros(len(self.p))
            if total > 0:
                m.cover = np.minimum(w @ self.dense[self.cells(m.x)] / total, 1.0)

    # Likelihood ---------------------------------------------------------------------------------

    def listen(self, value):
        weight = self.s["rate_weight"]
        more, louder = (weight + self.rates[:, 0]) / (weight + self.rates[:, 1])
        p, q, d, _ = self.sensors.T
        self.p = np.minimum(0.999, p * more)
        self.q = np.minimum(0.999 * self.p, q * louder)
        good = 1 - self.dead - self.stuck
        silent = (1.0, 0.0) if self.s["says_zero"] else (1 - d * (good + self.stuck), d * good)
        self.said = np.select([value == 1, value == 0], [good + self.stuck, 0.0], silent[0])
        self.quiet = np.select([value == 1, value == 0], [-good, 1.0], silent[1])

    def doubt(self, value):
        d, group = self.sensors[:, 2], self.sensors[:, 3]
        away = self.bare >= 0.95
        expected = (self.q * d)[away].sum()
        more = (value[away] == 1).sum() - self.s["most_new"] * self.dense.sum() / len(self.dense)
        if expected > 0 and more > expected:
            self.q = np.minimum(0.999 * self.p, self.q * more / expected)
        self.cut_off = np.zeros(len(d))
        for one in np.unique(group):
            of = group == one
            if (value[of] != -1).any():
                continue
            said = 1.0 if self.s["says_zero"] else 1 - (self.missed - self.q * self.bare)
            heard = np.minimum(0.999, d * (1 - self.dead - self.stuck) * said)
            silence = np.prod(1 - heard[of])
            outage = self.s["outage"]
            self.cut_off[of] = outage / (outage + (1 - outage) * silence)
        self.said = self.said + self.cut_off * (1 - self.said)
        self.quiet = self.quiet * (1 - self.cut_off)

    def background(self, without):
        self.missed, self.bare = np.ones(len(self.p)), np.ones(len(self.p))
        for group in self.groups:
            for m in group.members if group is not without else ():
                self.missed *= 1 - m.existence * m.cover * self.p
                self.bare *= 1 - m.existence * m.cover

    def words(self, missed, bare):
        return self.said + self.quiet * (missed - self.q * bare)

    def ratio(self):
        """Likelihood with one more target in each cell over that without."""
        with_one = self.words(self.missed * (1 - self.dense * self.p), self.bare * (1 - self.dense))
        return np.prod(with_one / self.words(self.missed, self.bare), axis=1) ** self.s["temper"]

    def update_alone(self, group):
        (m,) = group.members
        group.weight = group.weight * self.ratio()[self.cells(m.x)]
        mean, r = group.weight.sum(), m.existence
        m.existence = r * mean / (1 - r + r * mean)
        m.x = m.x[self.systematic(group.weight, len(m.x), self.chance.uniform(0))]
        self.spend(1)
        group.weight = np.full(len(m.x), 1.0 / len(m.x))

    def update_joint(self, group):
        missed, bare = self.missed[None], self.bare[None]
        for m in group.members:
            c = self.dense[self.cells(m.x)] * m.here[:, None]
            missed, bare = missed * (1 - c * self.p), bare * (1 - c)
        words = self.words(missed, bare) / self.words(self.missed, self.bare)
        w = group.weight * np.prod(words, axis=1) ** self.s["temper"]
        group.weight = w / w.sum()
        self.count(group)
        least = min(group.members, key=lambda m: m.existence)
        n, w, here = len(w), group.weight, least.here
        r, absent = (w * here).sum(), (w * ~here).sum()
        k = 0 if not r > 0 else n if not absent > 0 else min(n - 1, round_half(n * max(r, 0.5)))
        index = np.zeros(0, int)
        if k > 0:
            index = self.systematic(w * here, k, self.chance.uniform(0))
        if k < n:
            rest = self.systematic(w * ~here, n - k, self.chance.uniform(1))
            index = np.concatenate([index, rest])
        self.spend(2)
        for m in group.members:
            m.x, m.here = m.x[index], m.here[index]
        w = np.array([r / k if j < k else absent / (n - k) for j in range(n)])
        group.weight = w / w.sum()
        self.count(group)

    def learn(self, value, dt):
        s, d = self.s, self.sensors[:, 2]
        one, good = 1 - (self.missed - self.q * self.bare), 1 - self.dead - self.stuck
        heard = self.cut_off <= 0.5
        told = heard & (value >= 0) if s["says_zero"] else heard
        for row, near in enumerate((self.bare < 0.05, self.bare > 0.95)):
            weight, (known, tries) = s["rate_weight"], self.rates[row]
            expected = (good * one * (1.0 if s["says_zero"] else d))[told & near].sum()
            expected /= (weight + known) / (weight + tries)
            keep = math.exp(-expected / s["rate_memory"])
            hits = (value[told & near] == 1).sum()
            self.rates[row] = keep * self.rates[row] + [hits, expected]
        quiet = 1 - d if s["says_zero"] else 1 - d * one
        if_good = np.select([value == 1, value == 0], [d * one, 1.0], quiet)
        if_dead = (value < 0).astype(float)
        if_stuck = np.select([value == 1, value == 0], [d, 0.0], 1 - d)
        total = good * if_good + self.dead * if_dead + self.stuck * if_stuck
        back = 1 - math.exp(-dt / s["node_time"])
        for name, likely in (("dead", if_dead), ("stuck", if_stuck)):
            new = getattr(self, name) * likely / total
            new += back * (s[name] - new)
            setattr(self, name, np.where(heard, new, getattr(self, name)))

    # Births -------------------------------------------------------------------------------------

    def move_unseen(self, dt):
        s, (rows, columns) = self.s, self.shape
        survival = math.exp(-dt / s["lifetime"])
        for v, (vx, vy) in enumerate(self.velocity):
            old = self.unseen[v].reshape(self.shape)
            fresh = s["births_per_s"] * s["lifetime"] * (1 - survival)
            new = np.full(self.shape, fresh * self.prior[v] / old.size)
            for i, j in itertools.product(range(rows), range(columns)):
                y, x = i + vy * dt / self.width, j + vx * dt / self.width
                for di, dj in itertools.product((0, 1), (0, 1)):
                    to = (math.floor(y) + di, math.floor(x) + dj)
                    share = (1 - abs(y - to[0])) * (1 - abs(x - to[1]))
                    if 0 <= to[0] < rows and 0 <= to[1] < columns:
                        new[to] += survival * share * old[i, j]
            self.unseen[v] = new.ravel()

    def single_out(self):
        self.background(None)
        ratio = self.ratio()[self.place_cell]
        after = self.unseen.sum(axis=0) * ratio
        for _ in range(self.s["births_per_step"]):
            best = self.places[after.argmax()]
            near = ((self.places - best) ** 2).sum(1) <= self.s["birth_radius"] ** 2
            near = np.flatnonzero(near & (after > 0))
            told = after[near].sum()
            if told < self.s["least_birth"]:
                return
            x, weight = self.draw(near, after, ratio)
            self.settle(best, x, weight * told, told)
            after[near] = 0.0
            self.unseen[:, near] = 0.0

    def draw(self, near, after, ratio):
        n = self.s["particles"]
        c = near[self.systematic(after[near], n, self.chance.uniform(0))]
        self.spend(1)
        u = self.chance.uniform(5 * np.arange(n)[:, None] + np.arange(5))
        self.spend(5 * n)
        v = np.zeros(n, int)
        for j in range(n):
            sums = np.cumsum(self.unseen[:, c[j]])
            v[j] = min(np.searchsorted(sums, u[j, 0] * after[c[j]] / ratio[c[j]], "right"), 24)
        x = np.zeros((n, 4))
        x[:, :2] = self.places[c] + self.width * (u[:, 1:3] - 0.5)
        high = np.array([self.columns, self.rows]) * self.cell * (1 - 1e-9)
        low = np.array([self.x_min, self.y_min])
        x[:, :2] = np.clip(x[:, :2], low, low + high)
        x[:, 2:] = self.velocity[v] + 0.8 * self.s["velocity_sigma"] * (u[:, 3:] - 0.5)
        return x, 1.0 / ratio[c] / n

    def settle(self, at, x, weight, told):
        hosts = [
            (((m.mean[:2] - at) ** 2).sum(), group, m)
            for group in self.groups
            for m in group.members
            if m.existence < self.s["mature"] and not m.confirmed
        ]
        hosts = [host for host in hosts if host[0] < self.s["birth_reach"] ** 2]
        if hosts:
            _, group, m = min(hosts, key=lambda host: host[0])
            self.mix(group, m, x, weight, told)
            self.cover(group)
        elif sum(len(g.members) for g in self.groups) < self.s["most_members"]:
            odds = weight.sum()
            m = Member(self.next_track, x, odds / (1 + odds))
            m.mean[:2] = at
            self.next_track += 1
            self.groups.append(Group([m], weight / odds))
            w = self.groups[-1].weight
            m.cover = np.minimum(w @ self.dense[self.cells(x)] / w.sum(), 1.0)

    def mix(self, group, m, x, weight, told):
        n, there = len(x), m.existence
        share = min(max(told / (told + there), 0.05), 0.5)
        free = ~m.here if group.joint else np.ones(n, bool)
        take = free & (self.chance.uniform(np.arange(n)) < share)
        self.spend(n)
        w = np.where(free, group.weight / (1 - share), group.weight)
        mass = group.weight * n if group.joint else np.full(n, 1 / there)
        group.weight = np.where(take, mass * weight / share, w)
        m.x[take], m.here[take] = x[take], True
        odds = weight.sum()
        if not group.joint:
            m.existence = (there + odds) / (1 + odds)
        group.weight /= group.weight.sum()
        if group.joint:
            self.count(group)

    # Groups -------------------------------------------------------------------------------------

    def regroup(self):
        s = self.s
        flat = [(g, m) for g in self.groups for m in g.members]
        n = len(flat)
        young = [m.existence < s["mature"] for _, m in flat]
        links = []
        for a, b in itertools.combinations(range(n), 2):
            shared = np.minimum(flat[a][1].cover, flat[b][1].cover).max()
            least = s["part"] if flat[a][0] is flat[b][0] else s["join"]
            if shared > least and not (young[a] and young[b]):
                links.append((-shared, a, b))
        sets = [{k} for k in range(n)]
        for _, a, b in sorted(links):
            one, two = (next(t for t in sets if k in t) for k in (a, b))
            if one is two or len(one | two) > s["group_size"]:
                continue
            if sum(young[k] for k in one | two) > 1:
                continue
            sets = [t for t in sets if t is not one and t is not two] + [one | two]
        for group in self.groups:
            homes = {min(next(t for t in sets if k in t)) for k in range(n) if flat[k][0] is group}
            if len(homes) > 1:
                self.rename(group)
        old = self.groups
        self.groups = [self.assemble(sorted(t), flat) for t in sorted(sets, key=min)] if old else []

    def assemble(self, own, flat):
        result = None
        for part in dict.fromkeys(id(flat[k][0]) for k in own):
            members = [flat[k] for k in own if id(flat[k][0]) == part]
            group = members[0][0]
            piece = Group([m for _, m in members], group.weight.copy())
            if group.joint and len(own) == 1:
                self.marginal(group, piece.members[0])
                piece.weight = np.full(len(piece.weight), 1.0 / len(piece.weight))
            if not group.joint and len(own) > 1:
                self.flag(piece)
            if result is None:
                result = piece
                continue
            order = self.shuffled(len(result.weight))
            result.weight = result.weight * piece.weight[order]
            result.weight /= result.weight.sum()
            for m in piece.members:
                m.x, m.here = m.x[order], m.here[order]
            result.members += piece.members
        if result.joint:
            result.weight /= result.weight.sum()
            self.count(result)
        return result

    def flag(self, group):
        (m,) = group.members
        n, r = len(group.weight), m.existence
        k = n if r >= 1 else round_half(n * max(r, 0.5))
        order = self.shuffled(n)
        total = group.weight[order[:k]].sum()
        m.here[order[k:]] = False
        group.weight[order[:k]] *= r / total
        if k < n:
            group.weight[order[k:]] = (1 - r) / (n - k)

    def shuffled(self, n):
        order = np.arange(n)
        u = self.chance.uniform(np.arange(n))
        for j in range(n - 1, 0, -1):
            k = int(u[j] * (j + 1))
            order[j], order[k] = order[k], order[j]
        self.spend(n)
        return order

    # Names --------------------------------------------------------------------------------------

    def names(self, group):
        """Members that can change places, and for each particle which member takes whose name."""
        able = [m for m in group.members if m.existence >= self.s["mature"]][:4]
        k = len(able)
        if k < 2:
            return [], None
        horizon = np.array([1.0, 1.0, self.s["name_horizon"], self.s["name_horizon"]])
        x = np.stack([m.x for m in able], axis=1)
        complete = np.logical_and.reduce([m.here for m in able])
        anchors = np.stack([m.mean for m in able]).copy()
        namings = np.array(list(itertools.permutations(range(k))))
        for turn in range(4):
            cost = np.zeros((len(x), len(namings)))
            for p, naming in enumerate(namings):
                cost[:, p] = (((x[:, naming] - anchors) * horizon) ** 2).sum(axis=(1, 2))
            of = np.where(complete, cost.argmin(axis=1), 0)
            share = np.bincount(of[complete], group.weight[complete], minlength=len(namings))
            named = x[np.arange(len(x))[:, None], namings[of]]
            w = group.weight * complete
            means = np.einsum("j,jad->ad", w, named) / w.sum()
            most = share.argmax()
            anchors[namings[most]] = means
            if turn > 0 and most == 0:
                break
        return able, namings[of]

    def rename(self, group):
        able, of = self.names(group)
        if able:
            x = np.stack([m.x for m in able], axis=1)
            here = np.stack([m.here for m in able], axis=1)
            rows = np.arange(len(x))
            for a, m in enumerate(able):
                m.x, m.here = x[rows, of[:, a]], here[rows, of[:, a]]

    def summarize(self, group):
        able, of = self.names(group) if group.joint else ([], None)
        clouds = {id(m): m.x for m in group.members}
        if able:
            x = np.stack([m.x for m in able], axis=1)
            for a, m in enumerate(able):
                clouds[id(m)] = x[np.arange(len(x)), of[:, a]]
        for m in group.members:
            w = group.weight * m.here
            m.mean = w @ clouds[id(m)] / w.sum()


def round_half(x):
    """C's lround of a positive number."""
    return math.floor(x + 0.5)
