"""Positions of sources as centres of mass of the readings about a leader, Oh (12): paper mode."""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from scipy import spatial

from trackfield.errors import InputError
from trackfield.localization.source_fit import Sources, checked, nothing
from trackfield.types import Matrix, Vector

_KDTree = cast("Any", spatial).KDTree  # which has no types

_AT_ONCE = 256  # leaders whose neighbours are listed together: bounds the memory
_FIRST = 9  # nearest neighbours that most sensors lose the election against


class Election(NamedTuple):
    """Who speaks and who leads: a sensor speaks from `threshold` on, in units of its reading.

    It leads if it is louder than all that speak within 2 `sensing_range_m` of it.
    """

    threshold: float = 2.0
    sensing_range_m: float = 8.0


OH = Election()
"""Election of the paper's example, Oh IV.B.3, with R_s = 8."""


def locate(sensors: Matrix, values: Vector, *, election: Election = OH) -> Sources:
    """Find centres of mass sum z s / sum z over the speakers within 2 R_s of each leader, Oh (12).

    As printed: everything within 2 R_s is pooled, so that neighbours merge and estimates are pulled
    away from the border of the field; `source_fit` does neither. `values` (n,) of `sensors` (n, 2)
    [m] may be NaN where a sensor did not speak. Of equal readings the first leads. Amplitude is the
    leader's reading; there is no covariance, gain or misfit (NaN).
    """
    places, z = checked(sensors, values)
    if not (election.threshold > 0.0 and election.sensing_range_m > 0.0):
        raise InputError(f"{election}: expected a threshold and a sensing range > 0")
    speakers = np.flatnonzero(z >= election.threshold)
    if not speakers.size:
        return nothing()
    places, z = places[speakers], z[speakers]
    tree = _KDTree(places)
    radius_m = 2.0 * election.sensing_range_m
    leaders: list[int] = []
    estimates: list[Vector] = []
    candidates = _loudest_nearby(tree, z, radius_m)
    for k in range(0, len(candidates), _AT_ONCE):
        some = candidates[k : k + _AT_ONCE]
        for i, near in zip(some, tree.query_ball_point(places[some], radius_m), strict=True):
            heard = np.asarray(near, np.intp)
            louder = (z[heard] > z[i]) | ((z[heard] == z[i]) & (heard < i))
            if not louder.any():
                leaders.append(int(speakers[i]))
                estimates.append(z[heard] @ places[heard] / z[heard].sum())
    unknown = np.full(len(leaders), np.nan)
    return Sources(
        position=np.array(estimates),
        covariance=np.full((len(leaders), 3), np.nan),
        amplitude=np.asarray(values, float)[leaders],
        gain=unknown,
        leader=np.array(leaders, np.int32),
        misfit=unknown,
        suspects=np.empty(0, np.int32),
        complete=True,
    )


def _loudest_nearby(tree: Any, z: Vector, radius_m: float) -> NDArray[np.intp]:  # noqa: ANN401
    """Speakers louder than their nearest neighbours: only these need be heard by all in range."""
    count = min(_FIRST, len(z))
    _, found = tree.query(tree.data, k=[*range(1, count + 1)], distance_upper_bound=radius_m)
    near = np.asarray(found, np.intp)
    padded = np.append(z, -np.inf)  # the tree names one past the last where it finds no more
    own = np.arange(len(z))[:, None]
    beaten = (padded[near] > z[:, None]) | ((padded[near] == z[:, None]) & (near < own))
    return np.flatnonzero(~beaten.any(axis=1))
