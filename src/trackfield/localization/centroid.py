"""Positions of sources as centres of mass of the readings about a leader, Oh (12): paper mode."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from trackfield.errors import InputError
from trackfield.localization.source_fit import Sources, checked, nothing
from trackfield.types import Matrix, Vector

_AT_ONCE = 256  # leaders whose neighbours are listed together: bounds the memory
_FIRST = 9  # nearest neighbours that most sensors lose the election against


class Election(NamedTuple):
    """Who speaks and who leads: a sensor speaks from `threshold` on, in units of its reading.

    It leads if it is louder than all that speak within 2 `sensing_range_m` of it.
    """

    threshold: float = 2.0
    sensing_range_m: float = 8.0


def locate(sensors: Matrix, values: Vector, *, election: Election = Election()) -> Sources:
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
    tree = cKDTree(places)
    radius_m = 2.0 * election.sensing_range_m
    leaders: list[int] = []
    estimates: list[Vector] = []
    candidates = _loudest_nearby(tree, z, radius_m)
    for k in range(0, len(candidates), _AT_ONCE):
        some = candidates[k : k + _AT_ONCE]
        for i, near in zip(some, tree.query_ball_point(places[some], radius_m), strict=True):
            heard = np.array(near)
            if not (_louder(z, heard, i)).any():
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


def _loudest_nearby(tree: cKDTree, z: Vector, radius_m: float) -> Matrix:
    """Speakers louder than their nearest neighbours: only these need be heard by all in range."""
    _, near = tree.query(tree.data, k=min(_FIRST, len(z)), distance_upper_bound=radius_m)
    near = np.asarray(near).reshape(len(z), -1)
    padded = np.append(z, -np.inf)
    own = np.arange(len(z))[:, None]
    beaten = (padded[near] > z[:, None]) | ((padded[near] == z[:, None]) & (near < own))
    return np.flatnonzero(~beaten.any(1))


def _louder(z: Vector, others: Matrix, i: int) -> Matrix:
    return (z[others] > z[i]) | ((z[others] == z[i]) & (others < i))
