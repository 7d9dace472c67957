"""Pham 2.4 over one passage: how often the master hands over, what that costs, what it loses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.experiments.pham_passage import CYCLE_S, Heard, Passage, awake, distances
from trackfield.network.energy import Energy, message_energy, mode_energies
from trackfield.scheduling.activation import Zone
from trackfield.scheduling.master import NOBODY, choose, costs
from trackfield.types import Commands, Indices, Matrix, Mode, Vector

ALPHA = 0.2
MARGIN = 0.2
BATTERY_J = 10.0


class Rule(NamedTuple):
    """How masters are chosen: weight of the distance, margin of a hand-over, battery of a node."""

    alpha: float = ALPHA
    margin: float = MARGIN
    battery_j: float = BATTERY_J


class Reign(NamedTuple):
    """Who was master in each cycle: `master` (k,), -1 nobody, and what came of it.

    `forced` counts the hand-overs of masters that were left behind or exhausted; `residual` (n,)
    is what is left of each battery in the end, from 0 to 1; `messages_j` what hand-overs cost.
    """

    master: Indices
    hand_overs: int
    forced: int
    residual: Vector
    messages_j: float

    @property
    def begins(self) -> NDArray[np.bool_]:
        """Cycles (k,) in which a new master begins."""
        return np.append(False, np.diff(self.master) != 0)


def reign(way: Passage, nodes: Matrix, *, measuring_m: float, zone: Zone, rule: Rule) -> Reign:
    """Choose the master of every cycle by Pham 2.4 among the nodes within R_1 of the target.

    Distances count in units of R_1, which is also a master's reach. Each cycle of 5 ms takes from
    every node what its mode spends (`network.energy`), a master most of all, and each hand-over
    its message of 512 bits: residual power falls, and others become better.
    """
    energy = Energy()
    apart = distances(way, nodes)
    measuring, inside = apart <= measuring_m, awake(way, nodes, zone)
    near, relative = apart <= zone.near_m, np.minimum(apart / zone.near_m, 1.0)
    left = np.ones(len(nodes))
    masters, hand_overs, forced = np.full(len(apart), NOBODY, np.int32), 0, 0
    master = NOBODY
    for k in range(len(apart)):
        able = near[k] & (left > 0.0)
        cost = costs(relative[k], left, alpha=rule.alpha)
        stays = master != NOBODY and bool(able[master])
        chosen = choose(cost, master, able=able, may_stay=stays, margin=rule.margin)
        masters[k] = master = chosen.node
        hand_overs += chosen.handed_over
        forced += chosen.handed_over and chosen.forced
        spent = mode_energies(energy, CYCLE_S, sensing=measuring[k].sum())
        mode = modes_of(measuring[k], inside[k], master)
        drawn = spent[mode]
        if chosen.handed_over:
            drawn[chosen.previous] += 1e-6 * energy.state_bits * energy.tx_uj_per_bit
            drawn[master] += 1e-6 * energy.state_bits * energy.rx_uj_per_bit
        left = np.maximum(left - drawn / rule.battery_j, 0.0)
    cost_j = float(message_energy(energy, energy.state_bits, hand_overs))
    return Reign(masters, hand_overs, forced, left, cost_j)


def commands(way: Passage, nodes: Matrix, *, measuring_m: float, zone: Zone, masters: Indices
) -> Commands:  # fmt: skip
    """Say what nodes were told over a passage: a row wherever the mode of a node changes."""
    measuring, inside = distances(way, nodes) <= measuring_m, awake(way, nodes, zone)
    modes = np.array(
        [modes_of(*row) for row in zip(measuring, inside, masters.tolist(), strict=True)], np.int32
    )
    before = np.vstack([np.full((1, len(nodes)), Mode.SLEEPING, np.int32), modes[:-1]])
    k, node = np.nonzero(modes != before)
    names = tuple(f"n{i}" for i in range(len(nodes)))
    return Commands(way.t_s[k], node.astype(np.int32), modes[k, node], names)


def modes_of(measuring: Heard, inside: Heard, master: int) -> Indices:
    """Modes (n,) of one cycle, of who measures and who is in the region, (n,) each."""
    mode = np.where(measuring, Mode.SENSING, np.where(inside, Mode.ACTIVE, Mode.SLEEPING))
    if master != NOBODY:
        mode[master] = Mode.MASTER
    return mode.astype(np.int32)
