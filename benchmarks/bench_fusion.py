"""Fusion of signal strengths: error, coverage, false reports, honesty, time; the paper's rule too.

14 targets anywhere on a field of 100 x 100 sensors 1 m apart, R_s = 8, every scan drawn anew: so
targets stand near each other and near the border. A report is of a target if it is within 1 m.
Times are of the processor, the least of the scans of a row and their median.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from source_scenes import OH, ROUGH, grid, match, nis
from trackfield.localization import centroid, source_fit
from trackfield.localization.source_fit import Sources
from trackfield.localization.source_settings import settings_for
from trackfield.sensing import signal
from trackfield.sensing.signal import SignalModel

SEEDS = range(5)  # settings were chosen on seeds from 100 on


class Row(NamedTuple):
    """What became of all scans of a field."""

    error_m: float  # RMSE per axis of matched reports
    coverage: float  # share of targets that have a report
    false: float  # reports of no target, per scan
    nis: float  # mean; 2 is honest
    nis_clipped: float  # mean of min(NIS, 9); 1.98 is honest
    least_ms: float
    median_ms: float


class Field(NamedTuple):
    """A field of sensors, what they are, and how many targets move among them."""

    model: SignalModel
    side: int = 100
    spacing_m: float = 1.0
    targets: int = 14


def fit(field: Field) -> Callable[[np.ndarray, np.ndarray], Sources]:
    """Locate by maximum likelihood, told of everything that the field's model says."""
    settings = settings_for(field.model, grid(field.side, field.spacing_m))
    return lambda sensors, z: source_fit.locate(field.model, sensors, values=z, settings=settings)


def rule(sensors: np.ndarray, z: np.ndarray) -> Sources:
    """Locate by the paper's rule."""
    return centroid.locate(sensors, z)


def measure(
    field: Field, locate: Callable[[np.ndarray, np.ndarray], Sources], *, scans: int, seed: int
) -> Row:
    """Draw `scans` scans and locate their targets."""
    rng = np.random.default_rng(seed)
    sensors = grid(field.side, field.spacing_m)
    errors, honest, times = [], [], []
    found = false = 0
    for _ in range(scans):
        targets = rng.uniform(0, sensors.max(), (field.targets, 2))
        factors = np.exp(field.model.sigma_factor * rng.standard_normal(field.targets))
        z = np.concatenate(
            [
                signal.simulate(field.model, part, targets=targets, rng=rng, factors=factors)
                for part in np.array_split(sensors, -(-len(sensors) // 10_000))  # to bound memory
            ]
        )
        began = time.process_time()
        reports = locate(sensors, z)
        times.append(1e3 * (time.process_time() - began))
        pairs = match(reports, targets)
        errors.append(reports.position[pairs.reports] - targets[pairs.targets])
        honest.append(nis(reports, targets, pairs))
        found += len(pairs.targets)
        false += len(reports.position) - len(pairs.reports)
    q = np.concatenate(honest)
    return Row(
        error_m=float(np.sqrt(np.mean(np.concatenate(errors) ** 2))),
        coverage=found / (scans * field.targets),
        false=false / scans,
        nis=float(q.mean()),
        nis_clipped=float(np.minimum(q, 9.0).mean()),
        least_ms=min(times),
        median_ms=float(np.median(times)),
    )


def show(name: str, row: Row) -> None:
    """Print a row."""
    print(
        f"{name:34s} {row.error_m:7.4f} {row.coverage:7.4f} {row.false:6.3f} "
        f"{row.nis:7.2f} {row.nis_clipped:6.2f} {row.least_ms:8.2f} {row.median_ms:8.2f}"
    )


def mean(rows: list[Row]) -> Row:
    """Mean of rows over seeds; the least time is the least of all."""
    averages = Row(*np.mean(np.array(rows), axis=0))
    return averages._replace(least_ms=min(row.least_ms for row in rows))


def growth(sides: tuple[int, ...] = (100, 200, 400), *, scans: int = 3) -> float:
    """Exponent with which the time of a scan grows with the number of targets, density alike."""
    times = []
    for side in sides:
        field = Field(OH, side=side, targets=25 * (side // 100) ** 2)
        times.append(measure(field, fit(field), scans=scans, seed=0).median_ms)
    ratio = (sides[-1] / sides[0]) ** 2
    return float(np.log(times[-1] / times[0]) / np.log(ratio))


def main() -> None:
    """Print the table."""
    scans = int(sys.argv[1]) if len(sys.argv) > 1 else 40
    print(f"{'':34s} error/m   cover  false     NIS  NIS<9  least/ms median/ms")
    fields = {"exact sensors": Field(OH), "10 % gain, .1 m, strengths differ": Field(ROUGH)}
    for name, field in fields.items():
        show(name, mean([measure(field, fit(field), scans=scans, seed=s) for s in SEEDS]))
    show("exact sensors, paper's rule", measure(Field(OH), rule, scans=scans, seed=0))
    for sigma_m in (0.1, 0.2, 0.3, 0.5, 0.7, 1.0):
        field = Field(replace(OH, placement_sigma_m=sigma_m))
        show(f"places known to {sigma_m} m", measure(field, fit(field), scans=scans, seed=0))
    for spacing_m in (2.0, 3.0, 4.0):
        field = Field(OH, side=int(100 / spacing_m), spacing_m=spacing_m)
        show(f"{spacing_m:.0f} m apart", measure(field, fit(field), scans=scans, seed=0))
    print(f"time grows with targets (25 to 400) to the power of {growth():.2f}")


if __name__ == "__main__":
    main()
