"""Signal-strength models of a site made of the laws that its fingerprints follow."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.calibration.rssi_law import HeardPlaces, Laws, Scatter, fit_laws
from trackfield.errors import InputError
from trackfield.network.fingerprints import Fingerprints
from trackfield.network.radio_map import offsets_to, rssi_models
from trackfield.network.site import Site
from trackfield.sensing.rssi import RssiModel
from trackfield.types import Indices, Matrix, Vector

_LEAST_PLACES = 5
_LEAST_SPAN = 1.5  # farthest over nearest distance, without which an exponent is a guess
_FLATTEST = 0.1  # exponent


class ReceiverLaw(NamedTuple):
    """What was learned of one receiver; errors are standard errors, NaN-free.

    `fingerprints` is how many it was learned from, `off_db` the root mean square by which its own
    law and shadow miss a fingerprint that is left out (0 without any).
    """

    sensor_id: str
    fingerprints: int
    power_dbm: float
    power_error_db: float
    exponent: float
    exponent_error: float
    sigma_db: float
    off_db: float


@dataclass(frozen=True, slots=True, eq=False)
class CalibratedRssi:
    """A site with learned models of its receivers, and how well they foretell what was left out.

    `pooled` is the model of a receiver like the others of which nothing was heard. `map_error_db`
    is the root mean square error of leaving one fingerprint out, `law_error_db` the same without
    the shadow's map: the difference is what the map buys. `expected_error_db` is what the models
    expected of the first. `off` and `off_law` (m,) [dB] are these errors one by one, at
    `distance_m`, of receiver number `sensor`; `odd` of them are of fingerprints that count less.
    Fingerprints are of `used` readings, or rows of a survey, of `given`.
    """

    site: Site
    receivers: tuple[ReceiverLaw, ...]
    pooled: RssiModel
    map_error_db: float
    law_error_db: float
    expected_error_db: float
    off: Vector
    off_law: Vector
    distance_m: Vector
    sensor: Indices
    odd: int
    given: int
    used: int


class _Rows(NamedTuple):
    """Fingerprints in the order of receivers: their rows, distances, and noise of their means."""

    row: NDArray[np.intp]
    distance_m: Vector
    noise: Vector


def learn(site: Site, survey: Fingerprints, *, still_db: Vector) -> CalibratedRssi:
    """Learn the models of all receivers of `site` from a `survey`, see `rssi_law.fit_laws`.

    `still_db` (n,) is the scatter of each receiver's readings in one place. What a survey cannot
    tell, such as bodies in the way, is taken from the site, whose own survey stays.

    Raises `InputError` for fewer than 5 places, and where all of them are about as far from their
    receivers, so that no exponent follows.
    """
    models = rssi_models(site)
    rows = _checked(site, survey, models, still_db)
    heard = _heard(survey, rows, sensors=len(models))
    laws = fit_laws(heard, _start(models))
    counts = [one.x.size for one in heard]
    learned = tuple(
        _model(model, own, laws, still_db=still)
        for model, own, still in zip(models, laws.own, still_db.tolist(), strict=True)
    )
    return CalibratedRssi(
        site=replace(site, models=learned, target_models={}),
        receivers=_receivers(site, learned, laws, counts),
        pooled=_model(models[0], laws.common, laws, still_db=_root_mean_square(still_db)),
        map_error_db=_root_mean_square(laws.off),
        law_error_db=_root_mean_square(laws.off_law),
        expected_error_db=float(np.sqrt(laws.variance.mean())),
        off=laws.off,
        off_law=laws.off_law,
        distance_m=rows.distance_m,
        sensor=survey.sensor[rows.row],
        odd=int(np.sum(laws.weight < 1.0)),
        given=len(survey),
        used=len(survey),
    )


def _checked(
    site: Site, survey: Fingerprints, models: tuple[RssiModel, ...], still_db: Vector
) -> _Rows:
    places = np.unique(survey.position[:, :2].round(2), axis=0)
    if len(places) < _LEAST_PLACES:
        raise InputError(
            f"found fingerprints of {len(places)} places, expected {_LEAST_PLACES} or more apart"
        )
    row = np.argsort(survey.sensor, kind="stable")
    sensor = survey.sensor[row]
    offsets = offsets_to(site.positions, survey.position[row])[np.arange(row.size), sensor]
    near = np.array([model.near_m for model in models])[sensor]
    r = np.maximum(np.linalg.norm(offsets, axis=1), near)
    low, high = np.quantile(r, [0.05, 0.95])
    if high < _LEAST_SPAN * low:
        raise InputError(
            f"found fingerprints {low:.2f} to {high:.2f} m from their receivers, expected nearer "
            "and farther ones: from one distance no exponent follows"
        )
    std, count = survey.std_db[row], survey.count[row]
    scatter = np.where(np.isnan(std), still_db[sensor] ** 2, std**2)
    return _Rows(row, r, scatter / np.where(np.isnan(count), np.inf, count))


def _heard(survey: Fingerprints, rows: _Rows, *, sensors: int) -> list[HeardPlaces]:
    sensor = survey.sensor[rows.row]
    x, level = 10.0 * np.log10(rows.distance_m), survey.mean_dbm[rows.row]
    place = survey.position[rows.row, :2]
    return [
        HeardPlaces(place[mine], x[mine], level[mine], rows.noise[mine])
        for mine in (sensor == i for i in range(sensors))
    ]


def _start(models: tuple[RssiModel, ...]) -> Scatter:
    """Say what the site says of shadow and fading, where it says anything."""
    usual = Scatter()
    shadow = [model.shadow_db for model in models]
    if not min(shadow) > 0.0:
        return usual
    return usual._replace(
        shadow_db=float(np.mean(shadow)),
        shadow_m=float(np.exp(np.mean(np.log([model.shadow_m for model in models])))),
        fading_db=max(float(np.mean([model.fading_db for model in models])), 0.5),
    )


def _model(model: RssiModel, law: Vector, laws: Laws, *, still_db: float) -> RssiModel:
    level, exponent = law.tolist()
    exponent = max(exponent, _FLATTEST)
    scatter = laws.scatter
    return replace(
        model,
        power_dbm=level + exponent * laws.centre,
        exponent=exponent,
        sigma_db=float(np.hypot(still_db, scatter.fading_db)),
        shadow_db=scatter.shadow_db,
        shadow_m=scatter.shadow_m,
        fading_db=scatter.fading_db,
    )


def _receivers(
    site: Site, models: tuple[RssiModel, ...], laws: Laws, counts: list[int]
) -> tuple[ReceiverLaw, ...]:
    ends = np.cumsum(counts)
    lean = np.array([1.0, laws.centre])  # power = level + centre exponent
    return tuple(
        ReceiverLaw(
            sensor_id=name,
            fingerprints=count,
            power_dbm=model.power_dbm,
            power_error_db=float(np.sqrt(lean @ covariance @ lean)),
            exponent=model.exponent,
            exponent_error=float(np.sqrt(covariance[1, 1])),
            sigma_db=model.sigma_db,
            off_db=_root_mean_square(laws.off[end - count : end]),
        )
        for name, model, covariance, count, end in zip(
            site.sensor_ids, models, laws.covariance, counts, ends.tolist(), strict=True
        )
    )


def _root_mean_square(values: Matrix) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else 0.0
