"""Pham 2.4 and 5.3.1: what a sink gets of a passage, and what masters, relays, messages spend."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.experiments import pham_passage
from trackfield.experiments.pham_masters import ALPHA, MARGIN, modes_of
from trackfield.experiments.pham_passage import CYCLE_S, Passage
from trackfield.experiments.pham_table21 import PRINTED
from trackfield.network import meter
from trackfield.network.energy import Energy, message_energy, mode_energies
from trackfield.network.meter import Meter
from trackfield.network.meter_events import messages_along
from trackfield.network.relays import Relays, path_between, path_of, relays
from trackfield.scheduling.cost import energy_cost, inverse
from trackfield.scheduling.master import (
    NOBODY,
    Bells,
    Choice,
    choose,
    costs,
    costs_ahead,
    fitness,
    relative_costs,
)
from trackfield.types import Commands, Indices, Matrix, Mode, Vector

HOP_M = 0.75  # nodes of the square grid hear their eight neighbours
SINK = np.array([[0.0, 0.0]])  # at a corner of the field
BATTERY_J = 20.0
_BELLS = Bells(lead_m=0.2, ahead_m=0.5, behind_m=0.3, across_m=0.5)


class Policy(NamedTuple):
    """How masters are chosen: Pham (2.4), or `ahead` of the target and near the sink by (5.6)."""

    ahead: bool
    margin: float
    alpha: float = ALPHA

    @property
    def name(self) -> str:
        """How tables call it."""
        rule = "(5.6)" if self.ahead else "(2.4)"
        return f"{rule}, alpha {self.alpha:g}, margin {self.margin:g}"


POLICIES = (
    Policy(ahead=False, margin=0.0),
    Policy(ahead=False, margin=MARGIN),
    Policy(ahead=True, margin=0.0, alpha=0.8),
    Policy(ahead=True, margin=MARGIN, alpha=0.8),
)


class Service(NamedTuple):
    """What came of a passage: hand-overs, reports that arrived and were lost, hops of a report.

    `messages_j` is what reports and hand-overs cost all nodes, `found` the meter at the end.
    """

    policy: Policy
    hand_overs: int
    forced: int
    arrived: int
    lost: int
    mean_hops: float
    found: Meter

    @property
    def messages_j(self) -> float:
        """Energy of all messages."""
        return self.found.totals_j["sent"] + self.found.totals_j["received"]


def serve(way: Passage, nodes: Matrix, policy: Policy) -> Service:
    """Track a passage with the radii of the first row: every cycle a report goes to the sink.

    Residual power is the meter's: modes, the reports of 256 bits at every hop, and hand-overs of
    512 bits. When a node is exhausted, messages find another way.
    """
    row, energy = PRINTED[0], Energy()
    apart = pham_passage.distances(way, nodes)
    measuring, inside = apart <= row.measuring_m, pham_passage.awake(way, nodes, row.zone)
    names = tuple(f"n{i}" for i in range(len(nodes)))
    now = meter.init(energy, names, battery_j=BATTERY_J)
    to_sink = relays(nodes, SINK, hop_m=HOP_M)
    master, hand_overs, forced, hops, lost = NOBODY, 0, 0, list[int](), 0
    ends = np.append(way.t_s[1:], way.t_s[-1] + CYCLE_S)
    for k, (t_s, end_s) in enumerate(zip(way.t_s.tolist(), ends.tolist(), strict=True)):
        able = (apart[k] <= row.zone.near_m) & now.alive
        cost = _costs(policy, way, nodes, k=k, to_sink=to_sink, now=now)
        stays = master != NOBODY and bool(able[master])
        chosen = choose(cost, master, able=able, may_stay=stays, margin=policy.margin)
        master = chosen.node
        hand_overs += chosen.handed_over
        forced += chosen.handed_over and chosen.forced
        commands = _told(now, modes_of(measuring[k], inside[k], master), t_s)
        paths = _paths(chosen, nodes, to_sink, now)
        bits = [energy.report_bits, energy.state_bits][: len(paths)]
        sent = messages_along(t_s, bits, paths)
        now, spent = meter.step(now, end_s, commands=commands, messages=sent)
        hops += [len(paths[0]) - 1] * (len(paths) > 0)
        lost += int(spent.undelivered[:1].sum())
        if spent.exhausted.size:
            to_sink = relays(nodes, SINK, hop_m=HOP_M, works=now.alive)
    arrived = len(hops) - lost
    return Service(policy, hand_overs, forced, arrived, lost, float(np.mean(hops)), now)


def _costs(
    policy: Policy, way: Passage, nodes: Matrix, *, k: int, to_sink: Relays, now: Meter
) -> Vector:
    """Costs (n,) of all nodes as master of cycle k."""
    zone, left = PRINTED[0].zone, now.residual_j / now.battery_j
    target, heading = way.position[k], way.heading[k]
    if not policy.ahead:
        apart = np.hypot(*(nodes - target).T)
        return costs(np.minimum(apart / zone.near_m, 1.0), left, alpha=policy.alpha)
    as_master = float(mode_energies(now.energy, CYCLE_S)[Mode.MASTER])
    mastership = energy_cost(now.residual_j, as_master, price=inverse())
    near = np.hypot(*(nodes - target).T) <= zone.near_m
    rho = np.full(len(nodes), np.inf)
    per_hop = float(message_energy(now.energy, now.energy.report_bits, 1)) / BATTERY_J
    rho[near] = relative_costs(mastership[near], to_sink.hops[near], per_hop=per_hop)
    fit = fitness(_BELLS, nodes, target=target, heading=heading)
    return costs_ahead(rho, fit, alpha=policy.alpha)


def _told(now: Meter, modes: Indices, t_s: float) -> Commands:
    """Commands of a cycle: to those whose mode changes."""
    changed = np.flatnonzero(modes != now.mode).astype(np.int32)
    return Commands(np.full(changed.size, t_s), changed, modes[changed], now.sensor_ids)


def _paths(chosen: Choice, nodes: Matrix, to_sink: Relays, now: Meter) -> list[list[int]]:
    """Paths of a cycle's messages: the report to the sink, and the state to a new master."""
    if chosen.node == NOBODY:
        return []
    paths = [path_of(to_sink, chosen.node)]
    if chosen.handed_over and now.alive[chosen.previous]:
        ends = chosen.previous, chosen.node
        paths.append(path_between(nodes, ends, hop_m=HOP_M, works=now.alive) or [ends[0]])
    return paths
