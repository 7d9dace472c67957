"""Readings and reports on their way through the network: what arrives, when, and what is lost."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from trackfield.network.channel import transmit
from trackfield.network.detection_by_age import leaders_at
from trackfield.network.topology import UNREACHED, Network
from trackfield.raster import Region
from trackfield.types import Indices, Readings, Reports, Vector, select_rows

Sent = TypeVar("Sent", Readings, Reports)


class Passed(NamedTuple):
    """Counts of messages: `unreached` of those lost had no way, `delayed` of the others came late.

    What `dead` nodes and `silent` ones have not said is not among those sent.
    """

    sent: int = 0
    dead: int = 0
    lost: int = 0
    unreached: int = 0
    delayed: int = 0
    garbled: int = 0
    silent: int = 0

    def plus(self, other: Passed) -> Passed:
        """Add up, count by count."""
        return Passed(*(a + b for a, b in zip(self, other, strict=True)))


def pass_readings(
    readings: Readings,
    network: Network,
    rng: np.random.Generator,
    *,
    sent_s: Vector | None = None,
) -> tuple[Readings, Passed]:
    """Send each reading from its sensor to its leader; those that arrive, in order of arrival.

    They are sent at `sent_s` (n,) where clocks tell another time, else at their own.
    `Readings.sensor` are the places of the network's nodes. A garbled detection is turned about;
    any other value is off by a log-normal factor, as by wrong bits.
    """
    arrived, wrong, passed = _sent(
        readings.t_s if sent_s is None else sent_s, readings.sensor, network, rng
    )
    binary = np.array([kind == "detection" for kind in readings.kinds], np.bool_)
    value = np.where(
        binary[readings.kind] if binary.size else False,
        1.0 - readings.value,
        readings.value * np.exp(rng.standard_normal(len(readings))),
    )
    changed = replace(readings, value=np.where(wrong, value, readings.value), arrival_s=arrived)
    return in_order(changed), passed


def pass_reports(
    reports: Reports,
    network: Network,
    rng: np.random.Generator,
    *,
    region: Region,
    origin: Indices | None = None,
    sent_s: Vector | None = None,
) -> tuple[Reports, Passed]:
    """Send each report from a node to its leader; those that arrive, in order of arrival.

    The node is `origin` (n,), else the living one that is nearest to the report. They are sent at
    `sent_s` (n,) where clocks tell another time, else at their own. A garbled report has a position
    anywhere in the region.
    """
    node = leaders_at(network, reports.position[:, :2]) if origin is None else origin
    arrived, wrong, passed = _sent(reports.t_s if sent_s is None else sent_s, node, network, rng)
    position = reports.position.copy()
    anywhere = rng.uniform(region[:2], region[2:], (len(reports), 2))
    position[:, :2] = np.where(wrong[:, None], anywhere, position[:, :2])
    return in_order(replace(reports, position=position, arrival_s=arrived)), passed


def in_order(table: Sent) -> Sent:
    """Keep rows that arrive at all, in order of arrival; at the same time, in their own order."""
    order = np.argsort(table.arrival_s, kind="stable")
    return select_rows(table, order[: np.count_nonzero(np.isfinite(table.arrival_s))])


def _sent(
    t_s: Vector, origin: Indices, network: Network, rng: np.random.Generator
) -> tuple[Vector, NDArray[np.bool_], Passed]:
    """When messages arrive (n,), which are garbled, and the counts."""
    hops = network.routes.hops[origin]
    sent = transmit(network.channel, rng, t_s=t_s, hops=hops)
    alive = network.alive[origin]
    counts = Passed(
        sent=int(alive.sum()),
        dead=int((~alive).sum()),
        lost=int((alive & ~sent.arrived).sum()),
        unreached=int((alive & (hops == UNREACHED)).sum()),
        delayed=int((sent.arrived & (sent.arrival_s > t_s)).sum()),
        garbled=int(sent.garbled.sum()),
    )
    return sent.arrival_s, sent.garbled, counts
