"""Signal-strength models of a site learned from a run with truth."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.calibration.rssi_site import CalibratedRssi, learn
from trackfield.calibration.scatter import scatter_of_each
from trackfield.errors import InputError
from trackfield.network.fingerprints import Fingerprints
from trackfield.network.radio_map import offsets_to, rssi_models
from trackfield.network.site import Site
from trackfield.sensing import rssi
from trackfield.sensing.rssi import UNSURVEYED, RssiColumns, RssiModel
from trackfield.types import Indices, Matrix, Readings, Truth, Vector

KIND = "rssi"
_LEAST = 50  # readings beside truth
_CELL_M = 0.5  # of readings that become one fingerprint
_GAP_S = 2.0  # of truth, over which it is not interpolated
_GROSS = 5.0  # standard deviations from which a reading is an outlier before all else
_ROUNDS = 2
_PRIOR = 20.0  # readings that what the site says of bodies and outliers is worth
_MOST_CELLS = 1000  # of a receiver; where there are more, they are made larger
_EM_ROUNDS = 60
_LEAST_DB = 0.3  # scatter of readings that are rounded to whole dB


class _Beside(NamedTuple):
    """Readings with truth beside them, (m,): `position` (m, 3), number of `sensor` and `target`."""

    value: Vector
    sensor: Indices
    target: Indices
    position: Matrix


class _Mixture(NamedTuple):
    """What bodies and outliers do: a shift [dB], an `excess` of variance, and their shares."""

    shift: float
    excess: float
    p_blocked: float
    p_outlier: float


def calibrate_rssi(site: Site, readings: Readings, truth: Truth) -> CalibratedRssi:
    """Learn the models of all receivers of `site` from a run whose beacons' places are known.

    Readings of a receiver within half a metre become a fingerprint, gross outliers left out; from
    those, laws, shadow and fading as from a survey. Then power, noise, and the shares of bodies and
    outliers by maximum likelihood of the mixture (`sensing.rssi.log_density`) over what is left of
    single readings. Beacons that differ in power get models of their own.

    Raises `InputError` for sensors that the site does not have, fewer than 50 readings beside
    truth, and where `rssi_site.learn` does.
    """
    beside = _beside(site, readings, truth)
    offset = np.zeros(len(readings.target_ids) + 1)
    off = _first_guess(site, beside)
    found, off = _learned(site, beside, off=off, offset=offset)
    for _ in range(_ROUNDS - 1):
        offset = offset + _offsets(off, beside.target, offset.size)
        found, off = _learned(site, beside, off=off, offset=offset)
    offset = offset + _offsets(off, beside.target, offset.size)
    mixed = _mixture(off, rssi_models(site)[0])
    models = tuple(
        _mixed(model, mixed) for model in found.site.models if isinstance(model, RssiModel)
    )
    own = {
        name: tuple(replace(model, power_dbm=model.power_dbm + float(db)) for model in models)
        for name, db in zip(readings.target_ids, offset[:-1], strict=True)
    }
    return replace(
        found,
        site=replace(found.site, models=models, target_models=own if len(own) > 1 else {}),
        receivers=tuple(
            row._replace(power_dbm=model.power_dbm, sigma_db=model.sigma_db)
            for row, model in zip(found.receivers, models, strict=True)
        ),
        pooled=_mixed(found.pooled, mixed),
        given=int(np.sum(np.array([kind == KIND for kind in readings.kinds])[readings.kind])),
        used=beside.value.size,
    )


def _learned(
    site: Site, beside: _Beside, *, off: Vector, offset: Vector
) -> tuple[CalibratedRssi, Vector]:
    """Fit laws to the fingerprints of readings that are not grossly `off`.

    Also returns how far all readings are off what the other fingerprints foretell.
    """
    kept = np.abs(off - np.median(off)) <= _GROSS * _spread(off)
    value = beside.value - offset[beside.target]
    survey, cell, still = _fingerprints(site, beside._replace(value=value), kept)
    found = learn(site, survey, still_db=still)
    order = np.argsort(survey.sensor, kind="stable")
    foretold = np.empty(order.size)
    foretold[order] = survey.mean_dbm[order] - found.off
    return found, value - foretold[cell]


def _fingerprints(
    site: Site, beside: _Beside, kept: NDArray[np.bool_]
) -> tuple[Fingerprints, NDArray[np.intp], Vector]:
    """Means over cells of readings that are `kept`, each reading's cell, and the scatter in cells.

    A reading that is not kept belongs to a cell all the same, if only to be foretold there.
    """
    side = _CELL_M
    while True:
        places = np.floor(beside.position[:, :2] / side).astype(np.int64)
        key = np.column_stack([beside.sensor, places])
        _, cell = np.unique(key, axis=0, return_inverse=True)
        cell = cell.reshape(-1)
        full = np.bincount(cell, kept)
        # A cell of nothing but outliers has their mean, with the noise of all the world.
        weight = np.where(kept | (full[cell] == 0.0), 1.0, 0.0)
        first = np.unique(cell, return_index=True)[1]
        if np.bincount(beside.sensor[first]).max() <= _MOST_CELLS:
            break
        side *= 1.5
    count = np.bincount(cell, weight).astype(float)

    def mean(values: Vector) -> Vector:
        return np.bincount(cell, weight * values) / count

    level = mean(beside.value)
    inside = weight * (beside.value - level[cell]) ** 2
    still = scatter_of_each(
        np.bincount(cell, inside).astype(float),
        count - 1.0,
        sensor=beside.sensor[first],
        count=len(site.sensor_ids),
    )
    if still is None:  # no cell was visited twice
        still = np.array([model.sigma_db for model in rssi_models(site)])
    position = np.column_stack([mean(beside.position[:, axis]) for axis in range(3)])
    lone = np.full(count.size, np.nan)
    survey = Fingerprints(beside.sensor[first], position, level, lone, count)
    return survey, cell, np.maximum(still, _LEAST_DB)


def _first_guess(site: Site, beside: _Beside) -> Vector:
    """How far readings are off the site's own laws, each receiver's median taken away."""
    models = rssi.columns(rssi_models(site))
    r = np.linalg.norm(
        offsets_to(site.positions, beside.position)[np.arange(beside.value.size), beside.sensor],
        axis=1,
    )
    off = beside.value - rssi.expected(_of(models, beside.sensor), r)
    for i in np.unique(beside.sensor):
        mine = beside.sensor == i
        off[mine] -= np.median(off[mine])
    return off


def _offsets(off: Vector, target: Indices, size: int) -> Vector:
    """How much stronger (size,) each beacon is than their mean; 0 without a name."""
    known = np.unique(target[target >= 0])
    found = np.zeros(size)
    if known.size > 1:
        medians = np.array([np.median(off[target == k]) for k in known])
        found[known] = medians - medians.mean()
    return found


def _mixture(off: Vector, start: RssiModel) -> _Mixture:
    """Fit shift, noise and shares of the mixture to what is `off`, by expectation maximisation.

    How much a body takes away is the site's, for it is hardly told from its share. Shares begin at
    the usual ones where the site has none, for from 0 they would never rise.
    """
    start = replace(
        start,
        p_blocked=start.p_blocked or UNSURVEYED.p_blocked,
        p_outlier=start.p_outlier or UNSURVEYED.p_outlier,
    )
    sigma = _spread(off)
    model, shift = replace(start, sigma_db=sigma), 0.0
    for _ in range(_EM_ROUNDS):
        parts = rssi.shares(model, off - shift, variance=np.full(off.size, model.sigma_db**2))
        clear, blocked, _ = parts
        prior = _PRIOR * np.array([start.p_blocked, start.p_outlier])
        p_blocked, p_outlier = (parts[1:].sum(axis=1) + prior) / (off.size + _PRIOR)
        v = model.sigma_db**2
        w_blocked = blocked / (v + start.blocked_sigma_db**2)
        weight = clear / v + w_blocked
        aim = clear / v * off + w_blocked * (off + start.blocked_db)
        shift = float(aim.sum() / weight.sum())
        v = float(np.sum(clear * (off - shift) ** 2) / clear.sum())
        model = replace(
            model,
            sigma_db=float(np.sqrt(v)),
            p_blocked=float(p_blocked),
            p_outlier=float(p_outlier),
        )
    near = np.abs(off) <= _GROSS * sigma
    excess = float(np.var(off[near])) - model.sigma_db**2
    return _Mixture(shift, max(excess, 0.0), model.p_blocked, model.p_outlier)


def _mixed(model: RssiModel, mixture: _Mixture) -> RssiModel:
    """Take what bodies do out of the law and the noise of a model, and put their share in."""
    sigma = float(np.sqrt(max(model.sigma_db**2 - mixture.excess, 0.25 * model.sigma_db**2)))
    return replace(
        model,
        power_dbm=model.power_dbm + mixture.shift,
        sigma_db=sigma,
        fading_db=min(model.fading_db, sigma),
        p_blocked=mixture.p_blocked,
        p_outlier=mixture.p_outlier,
    )


def _beside(site: Site, readings: Readings, truth: Truth) -> _Beside:
    places = {name: i for i, name in enumerate(site.sensor_ids)}
    told = np.array([kind == KIND for kind in readings.kinds], bool)
    rows = np.flatnonzero(told[readings.kind]) if told.size else np.empty(0, np.intp)
    number = np.array([places.get(name, -1) for name in readings.sensor_ids], np.int32)
    if rows.size and (number[readings.sensor[rows]] < 0).any():
        name = readings.sensor_ids[int(readings.sensor[rows][number[readings.sensor[rows]] < 0][0])]
        raise InputError(f"found a strength of {name!r}, which is no sensor of the site")
    position = np.full((rows.size, 3), np.nan)
    known = np.zeros(rows.size, bool)
    for k in (-1, *range(len(readings.target_ids))):
        mine = readings.target[rows] == k
        name = "" if k < 0 else readings.target_ids[k]
        track = _track(truth, name, alone=len(readings.target_ids) <= 1)
        if track is not None:
            known[mine], position[mine] = _at(*track, readings.t_s[rows][mine])
    if known.sum() < _LEAST:
        raise InputError(
            f"found {int(known.sum())} of {rows.size} readings of kind 'rssi' with truth beside "
            f"them, expected {_LEAST} or more (targets of the readings: "
            f"{', '.join(readings.target_ids) or 'none'}; of the truth: "
            f"{', '.join(truth.target_ids)})"
        )
    rows = rows[known]
    if site.target.height_m is not None:
        position[:, 2] = site.target.height_m
    sensor = number[readings.sensor[rows]]
    return _Beside(readings.value[rows], sensor, readings.target[rows], position[known])


def _track(truth: Truth, name: str, *, alone: bool) -> tuple[Vector, Matrix] | None:
    """Find one target's times and places; an only truth serves an only target of any name."""
    if name in truth.target_ids:
        rows = np.flatnonzero(truth.target == truth.target_ids.index(name))
    elif alone and len(truth.target_ids) == 1:
        rows = np.arange(len(truth))
    else:
        return None
    rows = rows[np.argsort(truth.t_s[rows], kind="stable")]
    return truth.t_s[rows], truth.position[rows]


def _at(times: Vector, places: Matrix, t: Vector) -> tuple[NDArray[np.bool_], Matrix]:
    """Where a target was at `t`, and whether truth says so: within its time, outside its gaps."""
    after = np.clip(np.searchsorted(times, t), 1, max(times.size - 1, 1))
    known = (t >= times[0]) & (t <= times[-1])
    if times.size > 1:
        known &= times[after] - times[after - 1] <= _GAP_S
    return known, np.column_stack([np.interp(t, times, places[:, axis]) for axis in range(3)])


def _of(models: RssiColumns, sensor: Indices) -> RssiColumns:
    """Columns of models, a row a reading."""
    return RssiColumns(*(column[sensor] for column in models))


def _spread(values: Vector) -> float:
    """Estimate a standard deviation that a few outliers do not move."""
    return max(1.4826 * float(np.median(np.abs(values - np.median(values)))), _LEAST_DB)
