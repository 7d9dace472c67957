"""What one reading of any kind of sensor says of a target: a gain, whose square is information.

A reading z ~ N(h(x), v) says of x what g g' says, g = h'(x) / sqrt(v), its *gain*: a row of zeros
where it says nothing. Gains of independent readings stack, and G' G is their Fisher information.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.linalg import covariance_of
from trackfield.localization.bounds import Bound
from trackfield.localization.mixed_models import MixedModels, gains_at, mixed, taken
from trackfield.network.kinds import SensorModel
from trackfield.network.site import Site
from trackfield.types import Indices, Matrix

_FREE = 1e-12  # of the largest information, in units that make all alike: what rounding leaves

AnyModels = SensorModel | Sequence[SensorModel] | MixedModels
"""One model for all sensors, one each, or these laid out by `mixed_models.mixed`."""


def reading_gains(
    models: AnyModels, sensors: Matrix, states: Matrix, *, height_m: float | None = None
) -> Matrix:
    """Gains (..., n, D) of a reading of each of `sensors` (n, d) of a target in `states` (..., D).

    A state is a position (D = d), or a position and a velocity (D = 2 d), d = 2 or 3; sensors
    (n, 3) go with states in the plane at a known `height_m`. Sensors farther away than their
    `max_range_m` have a row of zeros. By kind:

    - range: a u / sqrt(v), and what the size of the noise tells of the distance, as
      `bounds.range_information`;
    - signal: h'(r) u / sqrt(v), for one target of the usual strength; nothing above `saturation`;
    - bearing: (-y, x) / (r^2 sigma_rad);
    - angular rate: `angular_rate.jacobian` / sigma_rad_s; nothing where states have no velocity,
      for a rate of unknown speed tells no place;
    - motion: `motion_rate.strength_slope` / sigma, with states that have a velocity;
    - rssi: `rssi.slope` over the root of sigma_db^2 + shadow_db^2; nothing below `min_dbm`;
    - detection: (p - q) c' / sqrt(P (1 - P)) on the soft edge of its region, P taken as
      .001 at least and .999 at most; nothing inside and outside, where the answer does not change
      with the place. What hard regions say is no Fisher information: see `detection_cells`.

    `InputError` for shapes that do not fit and values that are not finite.
    """
    p, v = _split(np.asarray(states, float), sensors, height_m)
    each = _each(models, len(sensors))
    offsets = p[..., None, :] - sensors
    return gains_at(
        each, offsets, None if v is None else v[..., None, :], plane=height_m is not None
    )


def pair_gains(
    models: AnyModels, sensors: Matrix, states: Matrix, *, height_m: float | None = None
) -> Matrix:
    """Gains (m, D) of pairs: row i of `sensors` (m, d) reads a target in row i of `states` (m, D).

    The same as `reading_gains` for each pair by itself, for fields in which few sensors are near.
    """
    p, v = _split(np.asarray(states, float), sensors, height_m)
    if p.shape != sensors.shape:
        raise InputError(f"found {len(sensors)} sensors and states of shape {np.shape(states)}")
    return gains_at(_each(models, len(sensors)), p - sensors, v, plane=height_m is not None)


def fisher_information(gains: Matrix) -> Matrix:
    """Information G' G (..., D, D) of all readings with `gains` (..., n, D)."""
    return np.swapaxes(gains, -1, -2) @ gains


def position_bound(information: Matrix, dimensions: int | None = None) -> Bound:
    """Cramer-Rao bound (..., d, d) [m^2] of the first `dimensions` entries of a state (..., D).

    The rest, a velocity, is unknown but for what `information` says of it: the bound is the inverse
    of A - B C^-1 B', the information left on the position.
    """
    d = information.shape[-1] if dimensions is None else dimensions
    if d == information.shape[-1]:
        return Bound(*covariance_of(information))
    place, cross = information[..., :d, :d], information[..., :d, d:]
    rest = np.linalg.pinv(information[..., d:, d:], rcond=1e-12, hermitian=True)
    left = place - cross @ rest @ np.swapaxes(cross, -1, -2)
    covariance, ok = covariance_of(0.5 * (left + np.swapaxes(left, -1, -2)))
    return Bound(covariance, np.asarray(ok & ~_leaves_free(information, d)))


def _leaves_free(information: Matrix, d: int) -> NDArray[np.bool_]:
    """Tell whether a direction (...) of which nothing is known moves the first `d` entries."""
    size = np.sqrt(np.diagonal(information, axis1=-2, axis2=-1))
    size = np.where(size > 0.0, size, 1.0)
    roots, axes = np.linalg.eigh(information / (size[..., :, None] * size[..., None, :]))
    free = roots <= _FREE * roots[..., -1:]
    return np.asarray(np.sum(axes[..., :d, :] ** 2 * free[..., None, :], axis=(-2, -1)) > _FREE)


def placed(
    site: Site, chosen: Indices | None = None, height_m: float | None = None
) -> tuple[MixedModels, Matrix, float | None]:
    """Lay out a site's sensors for `reading_gains`: models, places, and the height of targets.

    Places are (n, 3), or (n, 2) where heights do not count, as `site_gains` says.
    """
    every = np.arange(len(site.sensor_ids)) if chosen is None else np.asarray(chosen)
    positions = site.positions[every]
    models = mixed([site.models[i] for i in every])
    if site.target.dimensions == 3:
        if height_m is not None:
            raise InputError("found a height of targets on a site in space, expected none")
        return models, positions, None
    height_m = site.target.height_m if height_m is None else height_m
    if height_m is None:
        return models, positions[:, :2], None
    z = np.where(np.isfinite(positions[:, 2]), positions[:, 2], height_m)
    return models, np.column_stack([positions[:, :2], z]), height_m


def site_gains(
    site: Site, states: Matrix, *, chosen: Indices | None = None, height_m: float | None = None
) -> Matrix:
    """`reading_gains` (..., n, D) of a site's sensors, or of those `chosen` (n,).

    States have the site's `dimensions`, with or without velocity. In the plane, targets are at
    `height_m`, or at the height that the site knows; without either, heights do not count. A sensor
    without a height stands in the plane of the targets.
    """
    models, sensors, height_m = placed(site, chosen, height_m)
    return reading_gains(models, sensors, states, height_m=height_m)


def site_information(
    site: Site, states: Matrix, *, chosen: Indices | None = None, height_m: float | None = None
) -> Matrix:
    """Fisher information (..., D, D) of one reading of each sensor, see `site_gains`."""
    return fisher_information(site_gains(site, states, chosen=chosen, height_m=height_m))


def site_bound(
    site: Site,
    states: Matrix,
    *,
    chosen: Indices | None = None,
    height_m: float | None = None,
    prior: Matrix | None = None,
) -> Bound:
    """Cramer-Rao bound (..., d, d) [m^2] of positions on a site, see `site_gains`.

    `prior` (..., D, D) is information on the state that is there before the readings. A velocity is
    unknown but for that and what angular rates say.
    """
    information = site_information(site, states, chosen=chosen, height_m=height_m)
    total = information if prior is None else information + prior
    return position_bound(total, site.target.dimensions)


def _each(models: AnyModels, n: int) -> MixedModels:
    """One model for each of n sensors."""
    if isinstance(models, MixedModels):
        each = models
    elif isinstance(models, Sequence):
        each = mixed(models)
    else:
        each = taken(mixed([models]), np.zeros(n, np.int32))
    if len(each.part) != n:
        raise InputError(f"found {len(each.part)} models for {n} sensors, expected one each")
    return each


def _split(states: Matrix, sensors: Matrix, height_m: float | None) -> tuple[Matrix, Matrix | None]:
    """Positions (..., s) and velocities (..., s), or None, in the space of the sensors (n, s)."""
    s = sensors.shape[-1] if sensors.ndim == 2 else 0
    d = 2 if height_m is not None and s == 3 else s
    if s not in {2, 3} or states.shape[-1:] not in {(d,), (2 * d,)}:
        wanted = "(n, d), d = 2 or 3, and (..., d) or (..., 2 d)"
        above = "" if height_m is None else "; with a height, (n, 3) and (..., 2) or (..., 4)"
        raise InputError(
            f"sensors of shape {sensors.shape} and states of shape {states.shape}: "
            f"expected {wanted}{above}"
        )
    if height_m is not None and s != 3:
        raise InputError("a known height needs sensors with three coordinates, found two")
    if not (np.isfinite(states).all() and np.isfinite(sensors).all()):
        raise InputError("sensors and states must be finite, found NaN or infinity")
    p, v = states[..., :d], states[..., d:]
    if d < s:
        level = np.full((*p.shape[:-1], 1), height_m)
        p = np.concatenate([p, level], axis=-1)
        v = np.concatenate([v, np.zeros_like(level)], axis=-1) if v.shape[-1] else v
    return p, v if v.shape[-1] else None
