"""Models of sensors of any kinds, laid out by kind, and the gains of their readings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import ConfigurationError
from trackfield.localization.range_likelihood import fisher_weight
from trackfield.network.kinds import SensorModel, kind_of
from trackfield.sensing import angular_rate, bearing, detection, motion_rate, rssi, signal
from trackfield.sensing import range as ranging
from trackfield.sensing.amplitude import AmplitudeModel
from trackfield.sensing.angular_rate import AngularRateColumns, AngularRateModel
from trackfield.sensing.bearing import BearingColumns, BearingModel
from trackfield.sensing.detection import DetectionColumns, DetectionModel
from trackfield.sensing.energy_message import EnergyMessageModel
from trackfield.sensing.motion_rate import MotionRateColumns, MotionRateModel
from trackfield.sensing.range import RangeColumns, RangeModel, constant_variance
from trackfield.sensing.rssi import RssiColumns, RssiModel
from trackfield.sensing.signal import SignalColumns, SignalModel
from trackfield.types import Indices, Matrix, Vector

_OfPlaces = RangeColumns | SignalColumns | DetectionColumns | BearingColumns | RssiColumns
_OfMotion = AngularRateColumns | MotionRateColumns
_Columns = _OfPlaces | _OfMotion
_Some = TypeVar("_Some", bound=_Columns)
_LEAST_PROBABILITY = 1e-3  # a detection is not believed to be surer than this
_STEP_M = 1e-6  # over which the slope of a region's border is taken


class MixedModels(NamedTuple):
    """Models of n sensors of any kinds: that of sensor i is row `row[i]` of `columns[part[i]]`.

    Made by `mixed`, once for many calls.
    """

    part: Indices
    row: Indices
    columns: tuple[_Columns, ...]


def mixed(models: Sequence[SensorModel]) -> MixedModels:
    """Lay out the models of n sensors by kind.

    `ConfigurationError` for detection models that cannot be and for kinds that nothing is planned
    with, `InputError` for signal models that differ in what belongs to the field.
    """
    part, row = np.empty(len(models), np.int32), np.empty(len(models), np.int32)
    members: dict[type[SensorModel], list[int]] = {}
    for i, model in enumerate(models):
        members.setdefault(type(model), []).append(i)
    for number, places in enumerate(members.values()):
        part[places], row[places] = number, np.arange(len(places))
    columns = tuple(_columns([models[i] for i in places]) for places in members.values())
    return MixedModels(part, row, columns)


def taken(models: MixedModels, chosen: Indices) -> MixedModels:
    """Models of the sensors `chosen` (m,), in that order; one may be taken several times."""
    return models._replace(part=models.part[chosen], row=models.row[chosen])


def reach(models: MixedModels) -> Vector:
    """Distance (n,) [m] beyond which each sensor says nothing; of detections, in the plane."""
    out = np.empty(len(models.part))
    for number, columns in enumerate(models.columns):
        places = np.flatnonzero(models.part == number)
        far = (
            detection.reach(columns)
            if isinstance(columns, DetectionColumns)
            else _range_of(columns)
        )
        out[places] = far[models.row[places]]
    return out


def heard_at(models: MixedModels, offsets: Matrix) -> NDArray[np.bool_]:
    """Tell which sensors reach targets that stand `offsets` (..., n, s) [m] from them, (..., n).

    A detection reaches to the outer border of its soft edge.
    """
    out = np.empty(offsets.shape[:-1], bool)
    for number, columns in enumerate(models.columns):
        places = np.flatnonzero(models.part == number)
        if not places.size:
            continue
        own, near = _rows(columns, models.row[places]), offsets[..., places, :]
        if isinstance(own, DetectionColumns):
            out[..., places] = detection.depth_at(own, near[..., :2]) >= -0.5 * own.edge_m
        else:
            out[..., places] = np.linalg.norm(near, axis=-1) <= _range_of(own)
    return out


def gains_at(
    models: MixedModels, offsets: Matrix, velocities: Matrix | None, *, plane: bool
) -> Matrix:
    """Gains (..., n, D) of targets `offsets` (..., n, s) from their sensors.

    `velocities` (..., n, s), or (..., 1, s) for one target, or None where states have none; with
    `plane` the height is known and no part of the state. See `information.reading_gains`.
    """
    s = offsets.shape[-1]
    d = 2 if plane else s
    moving = velocities is not None
    out = np.zeros((*offsets.shape[:-1], 2 * d if moving else d))
    for number, columns in enumerate(models.columns):
        places = np.flatnonzero(models.part == number)
        if not places.size:
            continue
        own = _rows(columns, models.row[places])
        near = offsets[..., places, :]
        if isinstance(own, AngularRateColumns | MotionRateColumns):
            if moving:
                v = np.broadcast_to(velocities, offsets.shape)[..., places, :]
                full = _of_motion(own, near, v)
                out[..., places, :d], out[..., places, d:] = full[..., :d], full[..., s : s + d]
        else:
            out[..., places, :d] = _of_places(own, near)[..., :d]
    return out


def _columns(models: list[SensorModel]) -> _Columns:
    """Columns of models that are all of the kind of the first."""
    match models[0]:
        case RangeModel():
            return ranging.columns([m for m in models if isinstance(m, RangeModel)])
        case SignalModel():
            return signal.columns([m for m in models if isinstance(m, SignalModel)])
        case DetectionModel():
            return detection.columns([m for m in models if isinstance(m, DetectionModel)])
        case BearingModel():
            return bearing.columns([m for m in models if isinstance(m, BearingModel)])
        case AngularRateModel():
            return angular_rate.columns([m for m in models if isinstance(m, AngularRateModel)])
        case MotionRateModel():
            return motion_rate.columns([m for m in models if isinstance(m, MotionRateModel)])
        case RssiModel():
            return rssi.columns([m for m in models if isinstance(m, RssiModel)])
        case AmplitudeModel() | EnergyMessageModel():
            found = f"found sensors of kind {kind_of(models[0])!r}"
            expected = "kinds of which a single reading tells of the place"
            raise ConfigurationError([f"{found}, expected {expected}: others are not planned with"])


def _rows(columns: _Some, rows: Indices) -> _Some:
    """Rows of columns; what belongs to the whole field stays."""
    return columns._make(
        value[rows] if isinstance(value, np.ndarray) else value for value in columns
    )


def _range_of(
    columns: RangeColumns | SignalColumns | BearingColumns | RssiColumns | _OfMotion,
) -> Vector:
    """Distance (n,) [m] beyond which sensors say nothing; of beacons, where they are too weak."""
    if not isinstance(columns, RssiColumns):
        return columns.max_range_m
    decades = (columns.power_dbm - columns.min_dbm) / (10.0 * columns.exponent)
    return np.minimum(columns.max_range_m, 10.0 ** np.minimum(decades, 300.0))


def _of_places(columns: _OfPlaces, offsets: Matrix) -> Matrix:
    """Gains (..., m, s) of readings that depend on the place alone."""
    if isinstance(columns, DetectionColumns):
        return _of_detections(columns, offsets)
    r = np.linalg.norm(offsets, axis=-1)
    heard = r <= _range_of(columns)
    if isinstance(columns, BearingColumns):
        return bearing.slope(offsets) * (heard / columns.sigma_rad)[..., None]
    if isinstance(columns, RssiColumns):
        inverse = heard / np.sqrt(rssi.variance(columns, r))
        return rssi.slope(columns, offsets, r=r) * inverse[..., None]
    u = offsets / np.where(r > 0.0, r, 1.0)[..., None]
    if isinstance(columns, RangeColumns):
        constant = np.asarray(constant_variance(columns))
        weight = fisher_weight(1.0 + columns.scale, constant, columns.sigma_scale**2, r)
        return u * (heard * np.sqrt(weight))[..., None]
    seen = signal.strength(columns, r) <= columns.saturation
    steepness = signal.slope(columns, r) / np.sqrt(signal.variance_at(columns, r))
    return u * (steepness * seen)[..., None]


def _of_motion(columns: _OfMotion, offsets: Matrix, velocities: Matrix) -> Matrix:
    """Gains (..., m, 2 s) of readings that depend on the place and the velocity."""
    heard = np.linalg.norm(offsets, axis=-1) <= columns.max_range_m
    if isinstance(columns, AngularRateColumns):
        return angular_rate.slope(offsets, velocities) * (heard / columns.sigma_rad_s)[..., None]
    steep = motion_rate.strength_slope(columns, offsets, velocities)
    return steep * (heard / columns.sigma)[..., None]


def _of_detections(columns: DetectionColumns, offsets: Matrix) -> Matrix:
    """Gains on the soft edges; a region is flat, whatever the height."""
    out = np.zeros(offsets.shape)
    soft = np.flatnonzero(columns.edge_m > 0.0).astype(np.int32)
    if not soft.size:
        return out
    own, plane = _rows(columns, soft), offsets[..., soft, :2]
    depth = detection.depth_at(own, plane)
    c = 0.5 + depth / own.edge_m
    p, q = own.p_detection, own.p_false
    told = np.clip(p * c + q * (1.0 - c), _LEAST_PROBABILITY, 1.0 - _LEAST_PROBABILITY)
    scale: Vector = (p - q) / own.edge_m / np.sqrt(told * (1.0 - told)) * (np.abs(c - 0.5) < 0.5)
    for axis, step in enumerate(_STEP_M * np.eye(2)):
        rise = detection.depth_at(own, plane + step) - detection.depth_at(own, plane - step)
        out[..., soft, axis] = scale * rise / (2.0 * _STEP_M)
    return out
