"""Ranges of tagged targets, drawn only where nodes measure: those that sleep cost nothing."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from trackfield.network.node_index import NodeIndex
from trackfield.sensing import range as ranging
from trackfield.sensing.range import RangeModel
from trackfield.types import Matrix, Readings


@dataclass(frozen=True, slots=True, eq=False)
class RangesOnDemand:
    """Targets on `paths` (targets, steps, 2) [m], one place each `step_s`, and nodes that range.

    Every node has `model`, whose noise is white: a correlated error belongs to a node's whole run,
    and is not drawn here. A node tells the mean of `burst` measurements.
    """

    nodes: NodeIndex
    model: RangeModel
    paths: Matrix
    step_s: float
    rng: np.random.Generator
    burst: int = 1
    _sensor_ids: tuple[str, ...] = field(init=False, repr=False)
    _target_ids: tuple[str, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_sensor_ids", tuple(f"s{i}" for i in range(len(self.nodes))))
        object.__setattr__(self, "_target_ids", tuple(f"tag{i}" for i in range(len(self.paths))))

    def hear(self, from_s: float, to_s: float, *, sensing: NDArray[np.bool_]) -> Readings:
        """Draw what is heard from `from_s` to before `to_s` if the `sensing` (n,) nodes measure."""
        first, last = (math.ceil(t / self.step_s - 1e-9) for t in (from_s, to_s))
        steps = np.arange(first, min(last, self.paths.shape[1]))
        places = np.moveaxis(self.paths[:, steps], 0, 1).reshape(-1, 2)  # by time, then target
        node = np.flatnonzero(sensing).astype(np.int32)
        r = ranging.distance(self.nodes.positions[node], places)
        row, column = np.nonzero(r <= self.model.max_range_m)
        r = r[row, column]
        sigma = np.sqrt((self.model.sigma_m**2 + self.model.sigma_scale**2 * r**2) / self.burst)
        value = ranging.expected(self.model, r) + sigma * self.rng.standard_normal(r.size)
        step, target = np.divmod(row, max(len(self.paths), 1))
        return Readings(
            t_s=self.step_s * (first + step).astype(np.float64),
            sensor=node[column],
            value=np.maximum(value, 0.0),
            target=target.astype(np.int32),
            kind=np.zeros(r.size, np.int32),
            sigma=sigma,
            arrival_s=np.full(r.size, np.nan),
            sensor_ids=self._sensor_ids,
            target_ids=self._target_ids,
            kinds=("range",),
        )
