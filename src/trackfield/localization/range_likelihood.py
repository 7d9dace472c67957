"""How likely ranges are at a position: cost, gradient, Hessian and Fisher matrix, Wang (2)-(14)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.sensing.range import RangeModel, RangeModels, constant_variance, directions
from trackfield.types import Matrix, Vector


class RangeScan(NamedTuple):
    """Ranges of one moment: `ranges` (n,) [m] from `sensors` (n, 2) or (n, 3) [m].

    With `height_m`, sensors are in space, the target's height is known and its position is (x, y).
    Functions over many scans take `ranges` (B, n) of the same sensors.
    """

    sensors: Matrix
    ranges: Matrix
    models: RangeModels = RangeModel()
    height_m: float | None = None

    @property
    def dimensions(self) -> int:
        """Length d of a position: 2 or 3."""
        return self.sensors.shape[1] - (self.height_m is not None)


class Problem(NamedTuple):
    """A checked `RangeScan` as arrays that broadcast over B scans of n sensors.

    `excess` z - bias (B, n), `slope` 1 + scale (n,); the variance of a reading is `constant` (B, n)
    + `growth` (n,) r^2, and `variance` (B, n) with the reading for r. `used` (B, n) is 1 for
    readings that count, else 0.
    """

    sensors: Matrix
    height_m: float | None
    excess: Matrix
    slope: Vector
    constant: Matrix
    growth: Vector
    variance: Matrix
    used: Matrix

    def rows(self, chosen: NDArray[np.intp]) -> Problem:
        """Return the scans `chosen`."""
        return self._replace(
            excess=self.excess[chosen],
            constant=self.constant[chosen],
            variance=self.variance[chosen],
            used=self.used[chosen],
        )

    def stacked(self, count: int) -> Problem:
        """Return a stack of `count` scans from a stack of one or of `count`."""
        shape = (count, len(self.sensors))
        if len(self.excess) not in (1, count) or len(self.used) not in (1, count):
            raise InputError(f"{len(self.excess)} scans for {count} starts or selections")
        return self._replace(
            excess=np.broadcast_to(self.excess, shape),
            constant=np.broadcast_to(self.constant, shape),
            variance=np.broadcast_to(self.variance, shape),
            used=np.broadcast_to(self.used, shape),
        )


class Terms(NamedTuple):
    """Cost (B,), gradient (B, d), Hessian and Fisher matrix (B, d, d) at B positions."""

    cost: Vector
    gradient: Matrix
    hessian: Matrix
    fisher: Matrix


def problem(scan: RangeScan, used: NDArray[np.bool_] | None = None) -> Problem:
    """Check `scan` and lay it out for `terms`; one range vector becomes a stack of one.

    Raises `InputError` for shapes that do not fit, values that are not finite, negative ranges
    and models without noise.
    """
    sensors = np.asarray(scan.sensors, float)
    ranges = np.atleast_2d(np.asarray(scan.ranges, float))
    if sensors.ndim != 2 or sensors.shape[1] not in (2, 3) or len(sensors) == 0:
        raise InputError(f"sensors of shape {sensors.shape}: expected (n, 2) or (n, 3), n >= 1")
    if scan.height_m is not None and sensors.shape[1] != 3:
        raise InputError("a known height needs sensors with three coordinates, found two")
    if ranges.ndim != 2 or ranges.shape[1] != len(sensors):
        raise InputError(f"ranges of shape {ranges.shape} for {len(sensors)} sensors")
    if not (np.isfinite(sensors).all() and np.isfinite(ranges).all() and (ranges >= 0.0).all()):
        raise InputError("sensors must be finite, and ranges finite and not negative")

    n = len(sensors)
    slope = np.broadcast_to(np.asarray(1.0 + scan.models.scale), (n,))
    constant = np.broadcast_to(np.asarray(constant_variance(scan.models)), ranges.shape)
    growth = np.broadcast_to(np.asarray(scan.models.sigma_scale) ** 2, (n,))
    counted = np.ones(ranges.shape, bool) if used is None else np.atleast_2d(used)
    variance = constant + growth * ranges**2
    if ((variance <= 0.0) & counted).any() or (slope <= 0.0).any():
        raise InputError("range models need a noise above zero and a scale above -1")
    # Noise that is all multiplicative would vanish at the sensor, and the likelihood with it.
    least = 1e-6 * growth * ranges.max(axis=1, keepdims=True) ** 2
    return Problem(
        sensors=sensors,
        height_m=scan.height_m,
        excess=ranges - scan.models.bias_m,
        slope=slope,
        constant=np.where(constant > 0.0, constant, np.where(least > 0.0, least, 1.0)),
        growth=growth,
        variance=np.where(variance > 0.0, variance, 1.0),
        used=counted.astype(float),
    )


def terms(given: Problem, positions: Matrix, *, exact: bool) -> Terms:
    """Cost of `positions` (B, d), one for each scan, with its derivatives.

    With c_i = z_i - mu_n, a = 1 + mu_g and v_i = var_n + var_g z_i^2 the cost is Wang (9),
    sum (a r_i - c_i)^2 / (2 v_i), and the Hessian Wang (14), corrected: sum (1/v) [a^2 u u'
    + a (a r - c)/r (I - u u')]. If `exact`, v_i = var_n + var_g r_i^2 moves with the position and
    the cost is -log of Wang (6), less its value for a perfect fit: sum e^2/(2 v) + log(v/v_z)/2.
    The Fisher matrix then has the weights a^2/v + (2 r var_g)^2/(2 v^2), else a^2/v_z.
    """
    full = positions
    if given.height_m is not None:
        full = np.column_stack([positions, np.full(len(positions), given.height_m)])
    r, units = directions(given.sensors, full)
    u = units[..., : positions.shape[1]]
    value, first, second, weight = (
        term * given.used for term in (_exact(given, r) if exact else _paper(given, r))
    )
    bend = first / np.maximum(r, 1e-12)
    across = np.swapaxes(u, 1, 2)
    return Terms(
        cost=value.sum(axis=1),
        gradient=(across @ first[..., None])[..., 0],
        hessian=across @ (u * (second - bend)[..., None])
        + bend.sum(axis=1)[:, None, None] * np.eye(positions.shape[1]),
        fisher=across @ (u * weight[..., None]),
    )


def fisher_weight(slope: Vector, constant: Matrix, growth: Vector, r: Matrix) -> Matrix:
    """Fisher information of one reading on its distance, a^2/v + (2 r var_g)^2/(2 v^2) [1/m^2]."""
    v = np.maximum(constant + growth * r**2, np.finfo(float).tiny ** 0.5)
    return slope**2 / v + 2.0 * (growth * r / v) ** 2


def _paper(given: Problem, r: Matrix) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """Value, two derivatives in r and Fisher weight of each reading, variance from the reading."""
    a, v = given.slope, given.variance
    e = a * r - given.excess
    return 0.5 * e**2 / v, a * e / v, a**2 / v, a**2 / v


def _exact(given: Problem, r: Matrix) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """Return the same as `_paper`, with the variance taken at r."""
    a = given.slope
    v = given.constant + given.growth * r**2
    q = (a * r - given.excess) / v
    v1, v2 = 2.0 * given.growth * r / v, 2.0 * given.growth / v  # v'/v, v''/v
    misfit = 1.0 - v * q**2
    value = 0.5 * (v * q**2 + np.log(v / given.variance))
    first = a * q + 0.5 * v1 * misfit
    second = a**2 / v - 2.0 * a * q * v1 + v * q**2 * v1**2 + 0.5 * (v2 * misfit - v1**2)
    return value, first, second, fisher_weight(a, given.constant, given.growth, r)
