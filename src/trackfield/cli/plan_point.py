"""`trackfield plan SITE --at X,Y`: who should sense a target there."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from trackfield.cli.answers import Answer
from trackfield.cli.plan_map import mirror_doubts
from trackfield.errors import ConfigurationError, InputError
from trackfield.experiments.results import Table
from trackfield.network.bounds import FARTHEST_M

if TYPE_CHECKING:
    from trackfield.network.site import Site
    from trackfield.scheduling.point import PointPlan
    from trackfield.types import Matrix, Vector


def answer(
    site: Site, at: str, *, sensors: int | None, criterion: str, velocity: str | None
) -> Answer:
    """Select sensors for a target at `at`, numbers with commas."""
    from trackfield.plotting.choices import plot_choice
    from trackfield.scheduling.criteria import CRITERIA
    from trackfield.scheduling.point import plan_point

    if criterion not in CRITERIA:
        expected = "one of A (mean squared error), D (volume), E (worst direction)"
        raise ConfigurationError([f"--criterion: found {criterion!r}, expected {expected}"])
    place = numbers_of("--at", at, site.target.dimensions)
    speed = None if velocity is None else numbers_of("--velocity", velocity, place.size)
    k = site.scheduling.sensors if sensors is None else sensors
    plan = plan_point(site, place, k, criterion=criterion, velocity=speed)
    return Answer(
        _numbers(site, plan, criterion),
        _lines(plan, criterion),
        [_table(site, plan)] if plan.chosen.size else [],
        [*_doubts(plan, k), *mirror_doubts(site)],
        lambda: plot_choice(site, plan),
        failed=not plan.selection.determined,
    )


def numbers_of(option: str, text: str, count: int) -> Vector:
    """Read `count` numbers with commas between them."""
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError:
        values = np.empty(0)
    if values.size != count or not (np.abs(values) <= FARTHEST_M).all():
        expected = "X,Y" if count == 2 else "X,Y,Z"
        unit = "m/s" if option == "--velocity" else "metres"
        limits = f"{unit}, up to {FARTHEST_M:g} each"
        raise ConfigurationError([f"{option}: found {text!r}, expected {expected} in {limits}"])
    return values


def check_places(file: Path, places: Matrix) -> None:
    """Refuse places (n, d) [m] of a file that are too far away for any arithmetic."""
    farthest = float(np.abs(places).max(initial=0.0))
    if not farthest <= FARTHEST_M:
        expected = f"coordinates up to {FARTHEST_M:g} m"
        raise InputError(f"{file}: found {farthest:g} m, expected {expected}")


def _numbers(site: Site, plan: PointPlan, criterion: str) -> dict[str, object]:
    selection = plan.selection
    return {
        "at_m": plan.position.tolist(),
        "in_reach": int(plan.reach.size),
        "sensors": [site.sensor_ids[i] for i in plan.chosen],
        "criterion": criterion,
        "value": selection.value,
        "determined": selection.determined,
        "rms_m": _rms(selection.covariance) if selection.determined else None,
        "covariance_m2": selection.covariance.tolist() if selection.determined else None,
        "optimal": selection.optimal,
        "way": selection.way,
        "bound": selection.bound,
        "ratio": selection.ratio,
        "nearest_rms_m": None if len(plan.nearest.missing) else _rms(plan.nearest.covariance),
        "all_rms_m": None if len(plan.all.missing) else _rms(plan.all.covariance),
        "unknown_directions": selection.missing.tolist(),
    }


def _table(site: Site, plan: PointPlan) -> Table:
    distance = dict(zip(plan.reach.tolist(), plan.distance_m.tolist(), strict=True))
    rows: list[tuple[str, ...]] = []
    for i in map(int, plan.chosen):
        x, y = site.positions[i, :2].tolist()
        rows.append((site.sensor_ids[i], f"{x:.2f}", f"{y:.2f}", f"{distance[i]:.2f}"))
    return Table("", ("sensor", "x [m]", "y [m]", "distance [m]"), tuple(rows))


def _lines(plan: PointPlan, criterion: str) -> list[str]:
    """Say how well the target would be known."""
    place = ", ".join(f"{value:g}" for value in plan.position)
    said = [f"at ({place}) m: {plan.reach.size} sensors in reach"]
    if plan.selection.determined:
        within = 100.0 * (plan.selection.ratio - 1.0)
        way = (
            "no other set is better"
            if plan.selection.optimal
            else f"no other is better by more than {within:.2g} % in the criterion"
        )
        said.append(
            f"  rms error {_rms(plan.selection.covariance):.3g} m with these "
            f"{plan.chosen.size} ({criterion}-optimal; {way})"
        )
        for what, known in (("the nearest ones", plan.nearest), ("all in reach", plan.all)):
            told = "none: a direction stays unknown" if len(known.missing) else ""
            said.append(f"  with {what}: {told or f'{_rms(known.covariance):.3g} m'}")
    return said


def _doubts(plan: PointPlan, k: int) -> list[str]:
    found = plan.reach.size
    doubts: list[str] = []
    if found < k:
        doubts.append(f"found {found} sensors in reach, expected {k}: all of them were taken")
    for direction in plan.selection.missing:
        along = ", ".join(f"{value:.2f}" for value in direction)
        doubts.append(
            f"no reading tells where the target is along ({along}): too few sensors, all in "
            "line, or readings that do not change with the place"
        )
    return doubts


def _rms(covariance: object) -> float:
    return float(np.sqrt(np.trace(np.asarray(covariance))))
