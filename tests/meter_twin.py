"""The meter again, as a plain loop: events in order of time, nodes one by one, in scalars."""

from __future__ import annotations

import math
from itertools import pairwise

from trackfield.types import Mode

POSTS = 6


class Plain:
    """Nodes that spend: `spent[i][post]`, `died[i]`, as `network.meter` counts them."""

    def __init__(self, energy, batteries):
        n = len(batteries)
        self.energy, self.battery, self.t = energy, list(batteries), 0.0
        self.mode = [Mode.SLEEPING] * n
        self.spent = [[0.0] * POSTS for _ in range(n)]
        self.died = [math.inf] * n
        self.lost = []

    def alive(self, i):
        return math.isinf(self.died[i])

    def left(self, i):
        return self.battery[i] - math.fsum(self.spent[i])

    def power(self, i):
        e, mode = self.energy, self.mode[i]
        if mode == Mode.SLEEPING:
            return e.sleep_mw * 1e-3
        if mode == Mode.ACTIVE:
            return (e.rx_mw + e.idle_mw) * 1e-3
        if mode == Mode.SENSING:
            return (e.rx_mw + e.sense_mw + e.tx_mw + e.idle_mw) * 1e-3
        living = [self.mode[j] for j in range(len(self.mode)) if self.alive(j)]
        share = living.count(Mode.SENSING) / living.count(Mode.MASTER)
        return (e.tx_mw + share * e.rx_mw + e.compute_mw + e.idle_mw) * 1e-3

    def wait(self, until):
        while self.t < until:
            living = [i for i in range(len(self.mode)) if self.alive(i)]
            power = {i: self.power(i) for i in living}
            ends = {i: self.t + self.left(i) / power[i] for i in living if power[i] > 0}
            t = min([until, *ends.values()])
            for i in living:
                self.spent[i][self.mode[i]] += power[i] * (t - self.t)
                if ends.get(i, math.inf) <= t:
                    self.died[i] = t
            self.t = t

    def spend(self, i, joules, post):
        if not self.alive(i):
            return False
        left = self.left(i)
        self.spent[i][post] += min(joules, left)
        if left <= joules:
            self.died[i] = self.t
        return left >= joules

    def send(self, number, bits, path):
        e = self.energy
        for a, b in pairwise(path):
            if not self.spend(a, 1e-6 * (e.hop_uj + bits * e.tx_uj_per_bit), 4):
                break
            if b < len(self.mode) and not self.spend(b, 1e-6 * bits * e.rx_uj_per_bit, 5):
                break
        else:
            if len(path) > 1:
                return
        self.lost.append(number)

    def run(self, until, orders, messages):
        """`orders` (t, node, mode) and `messages` (t, number, bits, path)."""
        events = [(t, 0, k, row) for k, (t, *row) in enumerate(orders)]
        events += [(t, 1, k, row) for k, (t, *row) in enumerate(messages)]
        for t, kind, _, row in sorted(events, key=lambda event: event[:3]):
            self.wait(t)
            if kind:
                self.send(*row)
            elif self.alive(row[0]):
                self.mode[row[0]] = row[1]
        self.wait(until)
