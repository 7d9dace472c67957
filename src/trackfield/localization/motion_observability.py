"""What one moment's readings say of a target's position and velocity, to first order.

Cheng, Ghosh, Hu, Propositions 2.1, 2.4, 2.5, as corrected, by the rank and condition of the slopes
of the readings; and in words, which way the target could go without a reading that changes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from trackfield.errors import InputError
from trackfield.sensing.motion_vector import output_slope, sighting
from trackfield.types import Matrix, Vector

_RANK = 1e-9  # of the largest singular value, all in units of the scene
_PART = 1e-6  # of a direction: less of it is not spoken of
_ALIKE = 1e-6  # by which a direction may miss a turn or a growth of the scene


class Free(NamedTuple):
    """A way (2 n,) [m and m/s] the state may move unseen, of length one in units of the scene.

    `words` say it.
    """

    direction: Vector
    words: str


class Observability(NamedTuple):
    """Rank of the slopes of the readings in the 2 n entries of a state, and what is left free.

    `singular_values` (2 n,), with lengths in mean distances to the sensors and velocities in speeds
    of the target; `condition` is the first over the last, infinite where a direction is free.
    `place_rank` and `velocity_rank` are those of n columns each: what is known of the one if the
    other is known. `blind` lists sensors that the target stands on.
    """

    rank: int
    unknowns: int
    condition: float
    singular_values: Vector
    place_rank: int
    velocity_rank: int
    free: tuple[Free, ...]
    blind: tuple[int, ...]

    @property
    def observable(self) -> bool:
        """Whether the readings fix the state, locally."""
        return self.rank == self.unknowns


def sensors_needed(kind: str, dimensions: int) -> int | None:
    """How many sensors in general position fix position and velocity locally, at one moment.

    Cheng, Proposition 2.1, corrected: sizes of motion 2 n; angular rates ceil(2 n / (n - 1)); the
    vector output (2) as printed 2, for its direction tells bearings too. None for bearings, which
    tell no velocity at once. Two states with opposite velocities have the same sizes of motion,
    however many sensors there are.
    """
    n = dimensions
    if n < 2:
        raise InputError(f"found {n} dimensions, expected 2 or more")
    rates = math.ceil(2 * n / (n - 1))
    needed = {"motion": 2 * n, "angular_rate": rates, "vector": 2, "bearing": None}
    if kind not in needed:
        raise InputError(f"found readings of kind {kind!r}, expected one of {', '.join(needed)}")
    return needed[kind]


def observability(
    sensors: Matrix,
    state: Vector,
    *,
    kind: str = "motion",
    falloff: float = 1.0,
    velocities: Matrix | None = None,
) -> Observability:
    """Test what readings of `kind` of `sensors` (N, n) tell of a `state` (2 n,) at one moment.

    Kinds are those of `motion_vector.output_slope`. A target at rest has sizes of motion without
    any slope; a sensor that the target stands on says nothing. `velocities` (N, n) are those of
    sensors that move.
    """
    sensors, state = np.asarray(sensors, float), np.asarray(state, float)
    seen = sighting(sensors, state, velocities=velocities)
    n = sensors.shape[1]
    r = np.linalg.norm(seen.offsets, axis=-1)
    length = float(r.mean()) or 1.0
    speed = float(np.linalg.norm(seen.velocities, axis=-1).mean())
    blind = np.flatnonzero(r <= 1e-9 * length)
    slope = output_slope(seen, kind, falloff=falloff)
    unit = np.repeat([length, speed or length], n)
    power = {"bearing": 0.0, "angular_rate": 1.0}.get(kind, falloff)
    row = length**power / (1.0 if kind == "bearing" else speed or length)
    J = np.hstack([slope.place, slope.velocity]) * unit * row
    roots, axes = _svd(J)
    rank = _rank(roots, roots[0])
    place, velocity = (_rank(_svd(half)[0], roots[0]) for half in (J[:, :n], J[:, n:]))
    ways = _sorted_out(axes[rank:]) * unit
    condition = float(roots[0] / roots[-1]) if rank == 2 * n else math.inf
    where = tuple(int(i) for i in blind)
    return Observability(
        rank,
        2 * n,
        condition,
        roots,
        place,
        velocity,
        tuple(Free(way, _words(way, sensors, state)) for way in ways),
        where,
    )


def _svd(rows: Matrix) -> tuple[Vector, Matrix]:
    """Singular values (c,) of rows (m, c), filled up with zeros, and the right axes (c, c)."""
    _, roots, axes = np.linalg.svd(rows, full_matrices=True)
    return np.pad(roots, (0, rows.shape[1] - roots.size)), axes


def _rank(roots: Vector, size: float) -> int:
    """Count singular values that are more than rounding, of their own matrix and of the whole."""
    return int(np.sum(roots > _RANK * max(float(roots[0]), size, float(np.finfo(float).tiny))))


def _sorted_out(basis: Matrix) -> Matrix:
    """Turn a basis (k, 2 n) so that ways of the velocity alone come first, then of the place."""
    n = basis.shape[1] // 2
    out: list[Vector] = []
    rest = basis
    for other in (slice(0, n), slice(n, 2 * n)):
        if not len(rest):
            break
        _, roots, turn = np.linalg.svd(rest[:, other].T, full_matrices=True)
        still = np.pad(roots, (0, len(rest) - roots.size)) <= _PART
        out.extend(turn[still] @ rest)
        rest = turn[~still] @ rest
    return np.array([*out, *rest]).reshape(-1, 2 * n)


def _words(way: Vector, sensors: Matrix, state: Vector) -> str:
    """Say a way (2 n,) [m, m/s] in which the state is free."""
    n = way.size // 2
    x, v = state[:n], state[n:]
    place, velocity = way[:n], way[n:]
    scale = np.linalg.norm(x - sensors, axis=1).mean(), np.linalg.norm(v)
    still = np.linalg.norm(place) <= _PART * scale[0]
    steady = np.linalg.norm(velocity) <= _PART * (scale[1] or scale[0])
    if steady:
        return f"the place along {_shown(place)}"
    if still:
        return f"the velocity along {_shown(velocity)}{_of_sight(velocity, x - sensors)}"
    about = _similar(way, sensors, state) if n == 2 and scale[1] > 0.0 else None
    if about is not None:
        return about
    ratio = np.linalg.norm(velocity) / np.linalg.norm(place)
    return (
        f"the place along {_shown(place)} together with the velocity along {_shown(velocity)}, "
        f"{ratio:.3g} m/s for a metre"
    )


def _of_sight(velocity: Vector, offsets: Matrix) -> str:
    """Tell whether a change of velocity is along the lines of sight of all sensors."""
    r = np.maximum(np.linalg.norm(offsets, axis=1), np.finfo(float).tiny)
    cosine = np.abs(offsets @ velocity) / (r * np.linalg.norm(velocity))
    return ", the line of sight of all sensors" if (cosine > 1.0 - _PART).all() else ""


def _similar(way: Vector, sensors: Matrix, state: Vector) -> str | None:
    """Name a way that turns the scene about a sensor and blows it up; None if it does not.

    With z = x + i y, the velocity changes by c v for a complex c, and the place by c (x - s): s is
    then the point that stays.
    """
    x, v, dx, dv = (complex(*pair) for pair in (state[:2], state[2:], way[:2], way[2:]))
    c = dv / v
    fixed = x - dx / c
    away = np.abs(sensors[:, 0] + 1j * sensors[:, 1] - fixed)
    near = int(np.argmin(away))
    if away[near] > _ALIKE * max(abs(x - fixed), abs(dx / c)):
        return None
    return f"the whole scene, velocity too, turned and blown up about sensor {near}"


def _shown(vector: Vector) -> str:
    unit = vector / np.linalg.norm(vector)
    unit = np.where(np.abs(unit) > _PART, unit, 0.0)
    lead = unit[np.argmax(unit != 0.0)]
    return f"({', '.join(f'{u:.3g}' for u in unit * np.sign(lead) + 0.0)})"
