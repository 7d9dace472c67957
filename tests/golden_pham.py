"""Golden cases of Pham's dissertation: geometry, selection, energy, lifetime and the robot."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from trackfield.network.energy import Energy, network_power

Case = dict[str, Any]
Answer = dict[str, Any]


def network_energy(given: Case) -> Answer:
    energy = Energy(**{f"{name}_mw": float(given[name]) for name in ("tx", "rx", "idle", "sleep")})
    counts = {"measuring": given["na"], "warned": given["ni"], "watching": given["nb"]}
    return {"total": network_power(energy, given["n"], **counts)}


KINDS: dict[str, Callable[[Case], Answer]] = {
    "network_energy": network_energy,
}
