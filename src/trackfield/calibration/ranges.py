"""Range models of a site learned from a run with truth: bias, scale, noise, its correlation, clock.

The default is a robust regression with deviations of single sensors shrunk by what a calibration
run can tell of them; Wang's least squares over test distances is the paper mode.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.network.site import Site, range_models
from trackfield.sensing.range import RangeModel
from trackfield.sensing.range_residuals import (
    Fit,
    clock_offset,
    correlation,
    displacement_sigma,
    fit_bias_and_scale,
)
from trackfield.sensing.range_statistics import RangeTests, model, noise_statistics
from trackfield.types import Indices, Matrix, Readings, Truth, Vector

Method = Literal["robust", "weighted", "least squares"]
_LEAST = 30  # readings of a target, at least
_BINS = 12  # test distances that a run is cut into


class SensorCalibration(NamedTuple):
    """What a run told of one sensor (and one target, where several were calibrated)."""

    sensor_id: str
    target_id: str | None
    readings: int
    bias_m: float
    bias_error_m: float  # standard error
    scale: float
    scale_error: float
    sigma_m: float
    sigma_error_m: float


class Residuals(NamedTuple):
    """What the fit left over, one entry a reading: for pictures of how good it is."""

    t_s: Vector
    distance_m: Vector
    residual_m: Vector
    sensor: Indices
    target: Indices


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """A site with learned models, and how well they fit.

    `clock_offset_s` by target is what is added to the readings' times to meet the truth's clock;
    it is 0 where the run cannot tell it from 0. `used` of `given` readings had truth beside them.
    """

    site: Site
    sensors: tuple[SensorCalibration, ...]
    clock_offset_s: Mapping[str, float]
    clock_error_s: Mapping[str, float]
    residuals: Residuals
    given: int
    used: int


class _Samples(NamedTuple):
    """Readings of one target beside its truth."""

    t_s: Vector
    value: Vector
    sensor: Indices
    target: int


class _Learned(NamedTuple):
    models: tuple[RangeModel, ...]
    rows: tuple[SensorCalibration, ...]
    offset_s: float
    offset_error_s: float
    residuals: Residuals


def calibrate(
    site: Site, readings: Readings, truth: Truth, *, method: Method = "robust"
) -> Calibration:
    """Learn the range models of `site` from a run whose targets' places are known.

    Several targets are calibrated one by one, because an error belongs to the pair of anchor and
    tag; the site's own models are then their mean. `method` "weighted" and "least squares" take
    noise means and variances from Wang 3.1 over binned distances (non-negative weighted, or the
    paper's plain least squares) for all sensors alike. Raises `InputError` for readings of another
    kind, and if fewer than 30 readings of every target have truth beside them.
    """
    present: list[int] = np.unique(readings.kind).tolist()
    others = sorted({readings.kinds[k] for k in present} - {"range"})
    if others:
        raise InputError(
            f"found readings of kind {', '.join(others)}, expected range, as the site's sensors "
            'have no other model; [models.NAME] with kind = "..." gives them one'
        )
    learned: dict[str, _Learned] = {}
    used = 0
    names = readings.target_ids or ("",)
    for number, name in enumerate(names):
        track = _truth_of(truth, name, alone=len(names) == 1)
        mine = np.flatnonzero((readings.target == number) | (readings.target < 0))
        if track is None or not mine.size:
            continue
        order = mine[np.argsort(readings.t_s[mine], kind="stable")]
        samples = _Samples(
            readings.t_s[order], readings.value[order], _places(site, readings)[order], number
        )
        result = _learn(site, samples, track, name=name, method=method)
        if result is not None:
            learned[name] = result
            used += result.residuals.t_s.size
    if not learned:
        raise InputError(
            f"found no target with {_LEAST} readings beside its truth (targets of the readings: "
            f"{', '.join(readings.target_ids) or 'none'}; "
            f"of the truth: {', '.join(truth.target_ids)})"
        )
    columns = [one.models for one in learned.values()]
    calibrated = replace(
        site,
        models=tuple(_mean(models) for models in zip(*columns, strict=True)),
        target_models={} if len(learned) == 1 else {k: v.models for k, v in learned.items()},
    )
    parts = [one.residuals for one in learned.values()]
    return Calibration(
        site=calibrated,
        sensors=tuple(row for one in learned.values() for row in one.rows),
        clock_offset_s={k: v.offset_s for k, v in learned.items()},
        clock_error_s={k: v.offset_error_s for k, v in learned.items()},
        residuals=Residuals(*(np.concatenate(column) for column in zip(*parts, strict=True))),
        given=len(readings),
        used=used,
    )


def _learn(
    site: Site, samples: _Samples, track: tuple[Vector, Matrix], *, name: str, method: Method
) -> _Learned | None:
    """Models of all sensors from one target's readings; None if truth stands beside too few."""
    offset, offset_error = 0.0, 0.0
    kept, r, u = _geometry(site, samples, track, offset)
    if kept.sum() < _LEAST:
        return None
    if method == "robust":
        offset, offset_error = clock_offset(
            lambda s: _geometry(site, samples, track, s)[1], samples.value, kept
        )
        kept, r, u = _geometry(site, samples, track, offset)
    t, z, sensor = samples.t_s[kept] + offset, samples.value[kept], samples.sensor[kept]
    r, u = r[kept], u[kept]
    fit = fit_bias_and_scale(r, z - r, sensor, len(site.sensor_ids))
    place = _at(track, t)
    travelled = np.concatenate(
        ([0.0], np.cumsum(np.linalg.norm(np.diff(place[:, :2], axis=0), axis=1)))
    )
    share, length = correlation(fit.residual, sensor, travelled)
    # The run's own numbers stand in for a prior's: neither none nor all of the noise is white.
    ratio = float(np.clip(np.sqrt(share / max(1.0 - share, 1e-9)), 0.5, 1.5))
    white = 1.0 / np.sqrt(1.0 + ratio**2)
    placement = displacement_sigma(fit.residual, u[:, :2], t, white_sigma=fit.sigma)
    heard = np.bincount(sensor, minlength=len(site.sensor_ids)) > 0
    base = RangeModel(
        correlation_length_m=length,
        placement_sigma_m=placement,
        clock_offset_s=offset,
        learn_noise=True,
    )
    models = tuple(
        replace(
            base,
            bias_m=float(fit.bias[a]),
            scale=fit.scale,
            sigma_m=float(fit.sigmas[a] * white),
            correlated_sigma_m=float(fit.sigmas[a] * white * ratio),
            max_range_m=known.max_range_m,
            # A sensor that was not heard is only guessed at.
            bias_sigma_m=0.0 if heard[a] else float(fit.bias_error[a]),
        )
        for a, known in enumerate(range_models(site))
    )
    if method != "robust":
        models = _paper_models(site, r, z, method)
    residual = (
        z
        - np.array([(1 + m.scale) for m in models])[sensor] * r
        - np.array([m.bias_m for m in models])[sensor]
    )
    return _Learned(
        models,
        _rows(site, models, fit, sensor, name),
        offset,
        offset_error,
        Residuals(t, r, residual, sensor, np.full(t.size, samples.target, np.int32)),
    )


def _paper_models(
    site: Site, r: Vector, z: Vector, method: Literal["weighted", "least squares"]
) -> tuple[RangeModel, ...]:
    """Wang 3.1 for all sensors alike: the run's distances cut into bins that serve as tests."""
    edges = np.quantile(r, np.linspace(0.0, 1.0, _BINS + 1))
    where = np.clip(np.searchsorted(edges, r, side="right") - 1, 0, _BINS - 1)
    full = [b for b in range(_BINS) if np.sum(where == b) >= 3]
    centre = np.array([r[where == b].mean() for b in full])
    # Within a bin the distance varies: the mean is taken of z - r and put back at the centre.
    excess = [(z - r)[where == b] for b in full]
    tests = RangeTests(
        centre,
        centre + np.array([e.mean() for e in excess]),
        np.array([e.var(ddof=1) for e in excess]),
        np.array([float(e.size) for e in excess]),
    )
    learned = model(noise_statistics(tests, method=method))
    return tuple(replace(learned, max_range_m=m.max_range_m) for m in range_models(site))


def _rows(
    site: Site, models: tuple[RangeModel, ...], fit: Fit, sensor: Indices, name: str
) -> tuple[SensorCalibration, ...]:
    counts = np.bincount(sensor, minlength=len(models))
    return tuple(
        SensorCalibration(
            sensor_id=site.sensor_ids[a],
            target_id=name or None,
            readings=int(counts[a]),
            bias_m=model.bias_m,
            bias_error_m=float(fit.bias_error[a]),
            scale=model.scale,
            scale_error=fit.scale_error,
            sigma_m=float(np.hypot(model.sigma_m, model.correlated_sigma_m)),
            sigma_error_m=float(fit.sigmas[a] / np.sqrt(2.0 * max(int(counts[a]) - 1, 1))),
        )
        for a, model in enumerate(models)
    )


def _mean(models: tuple[RangeModel, ...]) -> RangeModel:
    """One model for targets that were not calibrated: the mean of those that were."""
    if len(models) == 1:
        return models[0]
    spread = float(np.std([m.bias_m for m in models], ddof=1))

    def mean(values: list[float]) -> float:
        return float(np.mean(values))

    return replace(
        models[0],
        bias_m=mean([m.bias_m for m in models]),
        scale=mean([m.scale for m in models]),
        sigma_m=mean([m.sigma_m for m in models]),
        correlated_sigma_m=mean([m.correlated_sigma_m for m in models]),
        correlation_length_m=mean([m.correlation_length_m for m in models]),
        placement_sigma_m=mean([m.placement_sigma_m for m in models]),
        clock_offset_s=mean([m.clock_offset_s for m in models]),
        bias_sigma_m=spread,
    )


def _places(site: Site, readings: Readings) -> Indices:
    """Site's number of each reading's sensor."""
    known = {name: i for i, name in enumerate(site.sensor_ids)}
    unknown = [name for name in readings.sensor_ids if name not in known]
    if unknown:
        raise InputError(f"found sensors that the site does not have: {', '.join(unknown)}")
    numbers = np.array([known[name] for name in readings.sensor_ids], np.int32)
    return numbers[readings.sensor]


def _truth_of(truth: Truth, name: str, *, alone: bool) -> tuple[Vector, Matrix] | None:
    """Find one target's times and places; an only truth serves an only target of any name."""
    if name in truth.target_ids:
        rows = np.flatnonzero(truth.target == truth.target_ids.index(name))
    elif alone and len(truth.target_ids) == 1:
        rows = np.arange(len(truth))
    else:
        return None
    order = rows[np.argsort(truth.t_s[rows], kind="stable")]
    return truth.t_s[order], truth.position[order]


def _at(track: tuple[Vector, Matrix], t: Vector) -> Matrix:
    times, places = track
    return np.stack([np.interp(t, times, places[:, i]) for i in range(3)], axis=1)


def _geometry(
    site: Site, samples: _Samples, track: tuple[Vector, Matrix], offset_s: float
) -> tuple[NDArray[np.bool_], Vector, Matrix]:
    """Which readings have truth beside them (no gap over 1 s), distances, directions."""
    times = track[0]
    t = samples.t_s + offset_s
    after = np.clip(np.searchsorted(times, t), 1, max(times.size - 1, 1))
    kept = (t >= times[0]) & (t <= times[-1])
    if times.size > 1:
        kept &= times[after] - times[after - 1] <= 1.0
    offsets = _at(track, t) - site.positions[samples.sensor]
    if site.target.height_m is not None:
        offsets[:, 2] = site.target.height_m - site.positions[samples.sensor, 2]
    # A height that one side does not know leaves the distance in the plane.
    offsets[:, 2] = np.where(np.isfinite(offsets[:, 2]), offsets[:, 2], 0.0)
    r = np.linalg.norm(offsets, axis=1)
    return kept, r, offsets / np.where(r > 0, r, 1.0)[:, None]
