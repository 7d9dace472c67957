"""The radio map of a site: the strength of a beacon at any place, from law and survey."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trackfield.errors import ConfigurationError, InputError
from trackfield.network.fingerprints import Fingerprints
from trackfield.network.kinds import kind_of
from trackfield.network.site import Site
from trackfield.sensing import rssi
from trackfield.sensing.rssi import RssiColumns, RssiModel
from trackfield.types import Matrix, Vector

_STEP = 0.02  # of the logarithm of a fingerprint's variance
_LEAST_NUGGET = 0.1  # [dB]: fingerprints are rounded, and two may stand in one place


class Strength(NamedTuple):
    """What receivers would hear of a beacon on a path that nothing blocks, (m, n) each.

    `mean` [dBm] and `variance` [dB^2] of the local mean: the noise of a reading comes on top.
    """

    mean: Matrix
    variance: Matrix


@dataclass(frozen=True, slots=True, eq=False)
class _Places:
    """Surveyed places, for all receivers that heard a beacon there alike well."""

    places: Matrix  # (p, 2)
    length_m: float
    precision: Matrix  # (p, p) (K + N)^-1 shadow_db^2, whose k' k is what the survey has settled


class _Receiver(NamedTuple):
    """What one receiver's fingerprints say of its shadow at surveyed places."""

    survey: _Places | None
    weights: Vector  # (p,) of each place's correlation [dB]: the mean of the shadow is k' weights


@dataclass(frozen=True, slots=True, eq=False)
class RadioMap:
    """Law and shadow of n receivers; made by `radio_map`.

    The shadow of a receiver is a Gaussian process over the plane, with the covariance of its model;
    fingerprints are its values plus the law's, seen with an error. Where nobody has surveyed, the
    law is left, and the whole variance of the shadow.
    """

    models: RssiColumns
    sensors: Matrix  # (n, 3), z NaN: in the plane of the targets
    height_m: float  # of a target whose place is told in the plane, NaN: none
    receivers: tuple[_Receiver, ...]

    def expected(self, positions: Matrix) -> Strength:
        """Strength at `positions` (m, d) [m], d 2 or 3."""
        _, r = self._offsets(positions)
        mean = rssi.expected(self.models, r)
        variance = np.broadcast_to(np.square(self.models.shadow_db), mean.shape).copy()
        surveys = {id(one.survey): one.survey for one in self.receivers if one.survey is not None}
        for survey in surveys.values():
            k = np.exp(-_apart(positions, survey.places) / survey.length_m)
            left = np.clip(1.0 - np.sum((k @ survey.precision) * k, axis=1), 0.0, 1.0)
            for i, receiver in enumerate(self.receivers):
                if receiver.survey is survey:
                    mean[:, i] += k @ receiver.weights
                    variance[:, i] *= left
        return Strength(mean, variance)

    def slope(self, positions: Matrix) -> Matrix:
        """Slope (m, n, d) [dB/m] of the mean in `positions` (m, d); at a surveyed place, the law's.

        There the shadow of an exponential covariance has none.
        """
        offsets, r = self._offsets(positions)
        found = rssi.slope(self.models, offsets, r=r)[..., : positions.shape[1]]
        for i, receiver in enumerate(self.receivers):
            if receiver.survey is None:
                continue
            length, places = receiver.survey.length_m, receiver.survey.places
            apart = _apart(positions, places)
            fall = np.where(apart > 0.0, np.exp(-apart / length) / np.maximum(apart, 1e-9), 0.0)
            pull = fall * receiver.weights / length
            toward = pull @ places - pull.sum(axis=1, keepdims=True) * positions[:, :2]
            found[:, i, :2] += toward
        return found

    def _offsets(self, positions: Matrix) -> tuple[Matrix, Matrix]:
        """Offsets (m, n, 3) from receivers to `positions`, and distances (m, n) [m]."""
        if positions.ndim != 2 or positions.shape[1] not in {2, 3}:
            raise InputError(f"positions of shape {positions.shape}: expected (m, d) with d 2 or 3")
        if positions.shape[1] == 2:
            positions = np.column_stack([positions, np.full(len(positions), self.height_m)])
        offsets = offsets_to(self.sensors, positions)
        return offsets, np.linalg.norm(offsets, axis=-1)


def radio_map(site: Site) -> RadioMap:
    """Make the radio map of `site` from its models and its survey, if it has one.

    `ConfigurationError` if a sensor measures something else.
    """
    models = rssi_models(site)
    columns = rssi.columns(models)
    survey = site.survey
    known: dict[bytes, _Places] = {}
    return RadioMap(
        models=columns,
        sensors=site.positions,
        height_m=np.nan if site.target.height_m is None else site.target.height_m,
        receivers=tuple(
            _Receiver(None, np.empty(0))
            if survey is None or model.shadow_db == 0.0
            else _receiver(model, site.positions[i], _of(survey, i), known)
            for i, model in enumerate(models)
        ),
    )


def rssi_models(site: Site) -> tuple[RssiModel, ...]:
    """Models of the sensors, where all of them measure signal strength.

    `ConfigurationError` names the first sensor that does not.
    """
    found = tuple(model for model in site.models if isinstance(model, RssiModel))
    if len(found) < len(site.models):
        place, other = next(
            (i, model) for i, model in enumerate(site.models) if not isinstance(model, RssiModel)
        )
        raise ConfigurationError(
            [
                f"site {site.name}: found sensor {site.sensor_ids[place]!r} of kind "
                f"{kind_of(other)!r}, expected 'rssi' of all: a radio map is of signal strength"
            ]
        )
    return found


def offsets_to(sensors: Matrix, positions: Matrix) -> Matrix:
    """Offsets (m, n, 3) [m] from `sensors` (n, 3) to `positions` (m, 3).

    A height that one side does not know leaves the offset in the plane.
    """
    offsets = positions[:, None, :] - sensors
    offsets[..., 2] = np.where(np.isfinite(offsets[..., 2]), offsets[..., 2], 0.0)
    return offsets


def mean_noise(model: RssiModel, std_db: Vector, count: Vector) -> Vector:
    """Variance (p,) [dB^2] of fingerprints about law and shadow: fading, and that of a mean.

    Where `std_db` is NaN, readings scatter as the model says; where `count` is NaN, they were many.
    """
    white = max(model.sigma_db**2 - model.fading_db**2, 0.0)
    scatter = np.where(np.isnan(std_db), white, std_db**2)
    many = np.where(np.isnan(count), np.inf, count)
    return _nugget(model) + scatter / many


def _nugget(model: RssiModel) -> float:
    """Variance [dB^2] of a fingerprint of any number of readings."""
    return max(model.fading_db, _LEAST_NUGGET) ** 2


def _of(survey: Fingerprints, place: int) -> Fingerprints:
    """Fingerprints of one receiver."""
    rows = survey.sensor == place
    return Fingerprints(
        survey.sensor[rows],
        survey.position[rows],
        survey.mean_dbm[rows],
        survey.std_db[rows],
        survey.count[rows],
    )


def _receiver(
    model: RssiModel, sensor: Vector, survey: Fingerprints, known: dict[bytes, _Places]
) -> _Receiver:
    """Learn a receiver's shadow; `known` places are shared, and grow."""
    if not len(survey):
        return _Receiver(None, np.empty(0))
    r = np.linalg.norm(offsets_to(sensor[None], survey.position)[:, 0], axis=1)
    off = survey.mean_dbm - rssi.expected(model, r)
    places = survey.position[:, :2]
    noise = mean_noise(model, survey.std_db, survey.count)
    # In steps of two percent, so that receivers that differ by next to nothing share an inverse.
    least = _nugget(model)
    ratio = least * np.exp(_STEP * np.round(np.log(noise / least) / _STEP)) / model.shadow_db**2
    key = np.column_stack([places, ratio]).tobytes() + np.float64(model.shadow_m).tobytes()
    if key not in known:
        K = np.exp(-_apart(places, places) / model.shadow_m) + np.diag(ratio)
        known[key] = _Places(places, model.shadow_m, np.asarray(np.linalg.inv(K), float))
    shared = known[key]
    return _Receiver(shared, shared.precision @ off)


def _apart(positions: Matrix, places: Matrix) -> Matrix:
    """Distances (m, p) [m] in the plane."""
    return np.sqrt(((positions[:, None, :2] - places) ** 2).sum(axis=-1))
