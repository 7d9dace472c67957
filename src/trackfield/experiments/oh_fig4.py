"""Oh, Fig. 4: error of one target's report against the sensing range, the paper's rule and ours."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield.localization import centroid, source_fit
from trackfield.localization.source_fit import Sources
from trackfield.localization.source_settings import settings_for
from trackfield.sensing import signal
from trackfield.sensing.signal import SignalModel
from trackfield.types import Matrix, Vector

RANGES_M = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
PAPER_M = (0.196, 0.114, 0.089, 0.074, 0.067, 0.058, 0.049, 0.046)
"""Read off Fig. 4 at `RANGES_M`."""


class Fig4(NamedTuple):
    """Mean distance [m] from the target to the report nearest to it, with standard errors.

    A row a sensing range (k,): `paper_m` as printed, `centroid_m` by the paper's rule here, `fit_m`
    by maximum likelihood over the scans in which it reports a target at all, `missed` the share of
    the others.
    """

    range_m: Vector
    paper_m: Vector
    centroid_m: Vector
    centroid_error_m: Vector
    fit_m: Vector
    fit_error_m: Vector
    missed: Vector


def model(range_m: float) -> SignalModel:
    """Give the sensors of Oh IV.B.3: alpha 2, gamma 1, beta = 3 (1 + R_s^2), nothing else wrong."""
    return SignalModel(
        amplitude=3.0 * (1.0 + range_m**2), max_range_m=range_m, sigma=1.0, sigma_gain=0.0
    )


def fig4(samples: int = 6000, *, fits: int = 500, seed: int = 4) -> Fig4:
    """Draw `samples` targets for each sensing range: the rule locates all, the fit `fits`.

    The reading of the setup that reproduces the figure: sensors 1 m apart on a grid whose border is
    far; a target anywhere between four of them; threshold 2 sigma; of all reports the one nearest
    to the target; the mean of its distance in the plane (not the RMSE, not per axis). The paper's
    1000 samples leave about 1.5 % of each value to chance.
    """
    rows = [
        _errors(range_m, samples, fits=fits, rng=np.random.default_rng([seed, k]))
        for k, range_m in enumerate(RANGES_M)
    ]
    by_rule = [errors[:, 0] for errors in rows]
    found = [errors[np.isfinite(errors[:, 1]), 1] for errors in rows]
    return Fig4(
        range_m=np.array(RANGES_M),
        paper_m=np.array(PAPER_M),
        centroid_m=np.array([e.mean() for e in by_rule]),
        centroid_error_m=np.array([_standard_error(e) for e in by_rule]),
        fit_m=np.array([e.mean() for e in found]),
        fit_error_m=np.array([_standard_error(e) for e in found]),
        missed=np.array([1.0 - e.size / min(fits, samples) for e in found]),
    )


def _errors(range_m: float, samples: int, *, fits: int, rng: np.random.Generator) -> Matrix:
    """Distances (samples, 2) [m] of the nearest report: of the paper's rule, of the first fits."""
    sensors = _grid(range_m)
    told = model(range_m)
    election = centroid.Election(threshold=2.0, sensing_range_m=range_m)
    settings = settings_for(told, sensors)
    errors = np.full((samples, 2), np.nan)
    for k, row in enumerate(errors):
        target = rng.random((1, 2))
        z = signal.simulate(told, sensors, targets=target, rng=rng)
        row[0] = _nearest(centroid.locate(sensors, z, election=election), target)
        if k < fits:
            row[1] = _nearest(source_fit.locate(told, sensors, values=z, settings=settings), target)
    return errors


def _nearest(found: Sources, target: Matrix) -> float:
    if not len(found.position):
        return np.nan
    return float(np.linalg.norm(found.position - target, axis=1).min())


def _grid(range_m: float) -> Matrix:
    """Places about the origin, so wide that the border is out of a leader's earshot."""
    half = int(np.ceil(2.0 * range_m)) + 2
    x: Vector = np.arange(-half, half + 2, dtype=float)
    return np.column_stack([np.tile(x, x.size), np.repeat(x, x.size)])


def _standard_error(errors: Vector) -> float:
    return float(errors.std() / np.sqrt(errors.size))
