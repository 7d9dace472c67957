"""Small fields of nodes and passes, and slow twins of the searches over them."""

from itertools import combinations

import numpy as np

from trackfield.scheduling.lifetime import Field
from trackfield.scheduling.lifetime_candidates import Need, candidates

NEED = Need(3.0 * 0.1**2, 3)


def passes(rng, count, intervals, *, size_m=10.0):
    """Sinusoids that cross a square from left to right, (count, intervals, 2) [m]."""
    t = np.linspace(0.0, 1.0, intervals)
    amplitude, middle = (
        size_m * rng.uniform(0.1, 0.3, (count, 1)),
        size_m * rng.uniform(0.3, 0.7, (count, 1)),
    )
    y = middle + amplitude * np.sin(2.0 * np.pi * t + rng.uniform(0, 2 * np.pi, (count, 1)))
    return np.stack([np.broadcast_to(size_m * t, y.shape), y], axis=-1)


def field(rng, count, *, battery=6.0, size_m=10.0, reach_m=1.4):
    return Field(rng.uniform(0.0, size_m, (count, 2)), 0.1, reach_m, battery)


def small(seed, *, nodes=30, intervals=12):
    """Candidates of one pass through a small field."""
    rng = np.random.default_rng(seed)
    made = field(rng, nodes, size_m=4.0)
    path = passes(rng, 1, intervals, size_m=4.0)
    return candidates(made.sensors, path, sigma_m=0.1, reach_m=1.4)


def accurate_sets(given, t, need):
    """All accurate sets of interval t, as tuples of node numbers."""
    a, b = given.offsets[t : t + 2]
    found = []
    for places in combinations(range(a, b), need.k):
        g = given.gains[list(places)]
        J = g.T @ g
        if np.linalg.cond(J) < 1e9 and np.trace(np.linalg.inv(J)) <= need.bound_m2:
            found.append(tuple(given.nodes[list(places)].tolist()))
    return found
