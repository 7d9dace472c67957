"""A robot that stays one hop from the sensors around a target: what it must do, and Pham's rule.

All sensors that sense the target hear the robot where, Pham (4.11),

    |M - T| <= G = tau_C - (tau_S + dtau_T)

with the communication radius, the sensing radius and the error of the target's position.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackfield.errors import InputError
from trackfield.types import Matrix, Vector

_SLACK = 1e-9  # of a reach: a robot that was put on a disc's border is in the disc, rounded or not


@dataclass(frozen=True, slots=True)
class Link:
    """Radii [m] of a radio hop (tau_C) and of sensing (tau_S), and the error of a target (dtau_T).

    The target is within `error_m` of where it is told to be. `InputError` where no disc is left:
    the robot could not be within a hop of all sensors that sense the target.
    """

    comm_m: float
    sensing_m: float
    error_m: float = 0.0

    def __post_init__(self) -> None:
        for name in ("comm_m", "sensing_m", "error_m"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise InputError(f"{name}: found {value}, expected a length [m], 0 or more")
        if not self.reach_m > 0.0:
            raise InputError(
                f"comm_m: found {self.comm_m} m, expected more than sensing_m + error_m = "
                f"{self.sensing_m + self.error_m:g} m: nowhere does the robot hear all sensors"
            )

    @property
    def reach_m(self) -> float:
        """G = tau_C - (tau_S + dtau_T) [m]: how far the robot may be from the target's place."""
        return self.comm_m - (self.sensing_m + self.error_m)


def least_move(positions: Matrix, targets: Matrix, *, reach_m: float | Vector) -> Matrix:
    """Next positions (..., 2) [m], nearest to the present ones within `reach_m` of the targets.

    |M_k M_{k+1}| = max(0, |M_k T_{k+1}| - G), towards the target: Pham's rule (4.11), corrected.
    """
    offset = positions - targets
    away = np.linalg.norm(offset, axis=-1, keepdims=True)
    reach = np.asarray(reach_m, np.float64)[..., None]
    share = reach / np.where(away > reach, away, 1.0)
    return np.where(away > reach, targets + share * offset, positions)


def rule_path(start: Vector, targets: Matrix, *, reach_m: float | Vector) -> Matrix:
    """Where the rule leads a robot from `start` (2,): (n, 2) [m], one place a target (n, 2)."""
    place, reach = np.asarray(start, np.float64), np.broadcast_to(reach_m, len(targets))
    path = np.empty((len(targets), 2))
    for k, target in enumerate(np.asarray(targets, np.float64)):
        place = path[k] = least_move(place, target, reach_m=reach[k])
    return path


def path_length(start: Vector, path: Matrix) -> float:
    """Length [m] of the way from `start` (2,) through the places `path` (n, 2)."""
    steps = np.diff(path, axis=0, prepend=np.asarray(start, np.float64)[None])
    return float(np.linalg.norm(steps, axis=1).sum())


def beyond(positions: Matrix, targets: Matrix, *, reach_m: float | Vector) -> Vector:
    """How far (...) [m] the robot is beyond its reach of the target; 0 where the hop is kept."""
    over = np.linalg.norm(np.asarray(positions) - targets, axis=-1) - reach_m
    return np.where(over > _SLACK * np.asarray(reach_m), over, 0.0)


def checked_track(start: Vector, targets: Matrix) -> tuple[Vector, Matrix]:
    """Start (2,) and targets (n, 2) as arrays of finite numbers, n > 0; else `InputError`."""
    place, track = np.asarray(start, np.float64), np.asarray(targets, np.float64)
    if place.shape != (2,) or track.ndim != 2 or track.shape[1] != 2 or not len(track):
        raise InputError(
            f"start of shape {place.shape} and targets of shape {track.shape}: expected (2,) and "
            "(n, 2) with n > 0"
        )
    if not (np.isfinite(place).all() and np.isfinite(track).all()):
        raise InputError("found a start or a target that is not finite, expected metres")
    return place, track
