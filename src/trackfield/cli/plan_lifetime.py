"""`trackfield plan SITE --lifetime`: for how long the field serves, with a policy of who senses."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from trackfield.cli.answers import Answer
from trackfield.cli.output import progress
from trackfield.cli.plan_map import region_of
from trackfield.cli.plan_point import check_places
from trackfield.errors import ConfigurationError, InputError
from trackfield.experiments.results import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from trackfield.network.site import Site
    from trackfield.scheduling.lifetime import Field, Lifetime
    from trackfield.scheduling.lifetime_candidates import Need
    from trackfield.types import Matrix, Vector

_INTERVALS = 25  # of a pass
_SENSINGS = 40.0  # of a node, at most, that are simulated; longer lives are in proportion
_PASSES = 40  # at least, before batteries of which more is simulated would be empty
_TRIED = 20  # passes, by which the share of them that can be served is told
_LEAST_SERVED = 0.1  # for which passes are made: they are 10 times as many then
_MOST_SENSORS = 4  # in a set that lives are simulated with
_DAY_S = 86400.0
_MARKS = (  # what is told of a life, and by which field of it
    ("first node exhausted", "first_death"),
    ("less than 90 % of what can be is served", "service_lifetime"),
    ("less than 90 % of places covered", "coverage_lifetime"),
)


class Wish(NamedTuple):
    """What is asked: how sets are chosen, of how many sensors, within which bound, for whom.

    `truth` holds passes in place of random crossings; `per_day` is how many there are; with
    `clairvoyant` what nobody can exceed is computed too.
    """

    policy: str
    sensors: int
    bound_m2: float | None
    truth: Path | None
    per_day: float | None
    seed: int
    clairvoyant: bool


class _Case(NamedTuple):
    """A field with batteries that are simulated, and the real ones in sensings of an interval."""

    field: Field
    battery: float
    sleep_per_day: float  # of a battery
    interval_s: float
    bound_m2: float


def answer(site: Site, wish: Wish) -> Answer:
    """Let targets pass until nodes are exhausted, by the policy asked for and by geometry."""
    from trackfield.scheduling.lifetime import lifetime
    from trackfield.scheduling.lifetime_candidates import Need
    from trackfield.scheduling.lifetime_policies import POLICIES

    if wish.policy not in POLICIES:
        expected = ", ".join(POLICIES)
        raise ConfigurationError([f"--policy: found {wish.policy!r}, expected one of: {expected}"])
    if wish.per_day is not None and not 0.0 < wish.per_day < math.inf:
        found = f"{wish.per_day:g}"
        raise ConfigurationError([f"--passes-per-day: found {found}, expected a rate above 0"])
    if wish.sensors > _MOST_SENSORS:
        expected = f"1 to {_MOST_SENSORS} with --lifetime"
        raise ConfigurationError([f"--sensors: found {wish.sensors}, expected {expected}"])
    case = _case(site, wish)
    need = Need(case.bound_m2, wish.sensors)
    passes = _passes(site, case, wish, need)
    with progress("targets pass") as moved:
        ours, plain = (
            lifetime(
                case.field,
                passes,
                need=need,
                chosen_by=policy,
                progress=lambda share, first=first: moved(first + 0.5 * share),
            )
            for first, policy in ((0.0, wish.policy), (0.5, "geometry"))
        )
    numbers = _numbers(case, ours, plain, wish)
    if wish.clairvoyant:
        numbers["nobody_longer_intervals"] = _bound(case, passes, need)
    return Answer(
        numbers,
        _lines(case, wish),
        [_table(numbers)],
        _doubts(case, ours, wish),
        lambda: _figure(site, ours, wish.policy),
        failed=ours.served == 0,
    )


def _case(site: Site, wish: Wish) -> _Case:
    from trackfield.network.energy import mode_powers
    from trackfield.network.site import range_models
    from trackfield.scheduling.lifetime import Field
    from trackfield.sensing.range import columns
    from trackfield.types import Mode

    ranges = columns(range_models(site))
    watts = 1e-3 * mode_powers(site.energy, wish.sensors)
    more = float(watts[Mode.SENSING] - watts[Mode.SLEEPING]) * site.scheduling.interval_s
    if more <= 0.0:
        problem = "energy: found sensing that costs no more than sleeping, expected more"
        raise ConfigurationError([f"site {site.name}: {problem}"])
    battery = site.energy.battery_j / more
    positions = site.positions[:, : site.target.dimensions]
    reach = np.minimum(ranges.max_range_m, _widest(positions))
    simulated = max(_SENSINGS, _PASSES * wish.sensors * _INTERVALS / len(positions))
    field = Field(positions, ranges.sigma_m, reach, min(battery, simulated))
    bound = 3.0 * float(np.median(ranges.sigma_m)) ** 2
    bound = bound if wish.bound_m2 is None else wish.bound_m2
    asleep = float(watts[Mode.SLEEPING]) * _DAY_S / site.energy.battery_j
    return _Case(field, battery, asleep, site.scheduling.interval_s, bound)


def _widest(positions: Matrix) -> float:
    """Distance [m] that no pair exceeds: ranges without an end reach as far."""
    return 2.0 * float(np.linalg.norm(np.ptp(positions, axis=0))) + 1.0


def _passes(site: Site, case: _Case, wish: Wish, need: Need) -> Matrix:
    """Make passes (p, `_INTERVALS`, d) until batteries would be empty if what can be is served."""
    from trackfield.scheduling.lifetime import lifetime

    most = float(np.asarray(case.field.battery)) * len(case.field.sensors)
    count = max(1, math.ceil(most / (wish.sensors * _INTERVALS)))
    made = _made(site, case, wish, count)
    tried = lifetime(case.field, made[:_TRIED], need=need, chosen_by="geometry")
    served = 1.0 - tried.geometric / (tried.served + tried.failed)
    if served in (0.0, 1.0):
        return made
    return _made(site, case, wish, math.ceil(count / max(served, _LEAST_SERVED)))


def _made(site: Site, case: _Case, wish: Wish, count: int) -> Matrix:
    """Draw `count` passes, the same ones for the same seed."""
    sensors = np.asarray(case.field.sensors)
    rng = np.random.default_rng(wish.seed)
    if wish.truth is None:
        return _crossings(site, count, rng)
    from trackfield.io.truth import read_truth

    table, d = read_truth(wish.truth), sensors.shape[1]
    if not np.isfinite(table.position[:, :d]).all():
        expected = "heights of targets in space"
        raise InputError(f"{wish.truth}: z_m: found nothing, expected {expected}")
    check_places(wish.truth, table.position[:, :d])
    known = [_evenly(table.position[table.target == i, :d]) for i in range(len(table.target_ids))]
    return np.stack([known[int(i)] for i in rng.integers(0, len(known), count)])


def _evenly(walk: Matrix) -> Matrix:
    """Places (`_INTERVALS`, d) of a walk (n, d), evenly over its rows."""
    row, share = np.linspace(0.0, 1.0, len(walk)), np.linspace(0.0, 1.0, _INTERVALS)
    axes: list[Vector] = [np.interp(share, row, x) for x in walk.T]
    return np.column_stack(axes)


def _crossings(site: Site, count: int, rng: np.random.Generator) -> Matrix:
    """Straight ways from one side of the region to another, at places and sides drawn evenly."""
    low_x, low_y, high_x, high_y = region_of(site)
    low, size = np.array([low_x, low_y]), np.array([high_x - low_x, high_y - low_y])
    side = rng.integers(0, 4, count)
    sides = np.stack([side, (side + rng.integers(1, 4, count)) % 4])
    along = rng.uniform(size=(2, count))
    across = (sides >= 2).astype(float)  # on the far side, or the near one
    lying, standing = np.stack([along, across], -1), np.stack([across, along], -1)
    ends = np.where((sides % 2 == 1)[..., None], standing, lying)
    begin, end = low + size * ends
    share = np.linspace(0.0, 1.0, _INTERVALS)[:, None]
    ways = begin[:, None] + share * (end - begin)[:, None]
    if site.target.dimensions == 3:
        height = float(np.nanmean(site.positions[:, 2]))
        ways = np.concatenate([ways, np.full((*ways.shape[:2], 1), height)], axis=-1)
    return ways


def _numbers(case: _Case, ours: Lifetime, plain: Lifetime, wish: Wish) -> dict[str, Any]:
    return {
        "policy": wish.policy,
        "sensors": wish.sensors,
        "bound_m2": case.bound_m2,
        "interval_s": case.interval_s,
        "battery_sensings": case.battery,
        "simulated_sensings": float(np.asarray(case.field.battery)),
        "intervals": {key: _scaled(case, getattr(ours, key)) for _, key in _MARKS},
        "geometry_intervals": {key: _scaled(case, getattr(plain, key)) for _, key in _MARKS},
        "days": {key: _days(case, getattr(ours, key), wish) for _, key in _MARKS},
        "served": ours.served,
        "failed": ours.failed,
        "failed_whatever_batteries": ours.geometric,
        "sleeping_days": 1.0 / case.sleep_per_day if case.sleep_per_day else None,
    }


def _scaled(case: _Case, interval: int | None) -> float | None:
    """Intervals with real batteries: in proportion to those that were simulated."""
    if interval is None:
        return None
    return interval * case.battery / float(np.asarray(case.field.battery))


def _days(case: _Case, interval: int | None, wish: Wish) -> float | None:
    """Days D until then: what D days asleep take of a battery is not there for sensing."""
    served = _scaled(case, interval)
    if served is None or wish.per_day is None:
        return None
    return served / (wish.per_day * _INTERVALS + served * case.sleep_per_day)


def _bound(case: _Case, passes: Matrix, need: Need) -> float | None:
    """Intervals after which some node is exhausted whoever chooses, knowing all passes."""
    from trackfield.scheduling.clairvoyant import first_death_bound
    from trackfield.scheduling.lifetime_candidates import candidates

    sensors = np.asarray(case.field.sensors)
    given = candidates(sensors, passes, sigma_m=case.field.sigma_m, reach_m=case.field.reach_m)
    battery = np.full(len(sensors), float(np.asarray(case.field.battery)))
    return _scaled(case, first_death_bound(given, battery, need=need).interval)


def _table(numbers: dict[str, Any]) -> Table:
    def text(value: float | None) -> str:
        return "-" if value is None else f"{value:.4g}"

    days = any(value is not None for value in numbers["days"].values())
    rows: list[tuple[str, ...]] = []
    for what, key in _MARKS:
        cells = [numbers["intervals"][key], numbers["geometry_intervals"][key]]
        cells += [numbers["days"][key]] if days else []
        rows.append((what, *map(text, cells)))
    if "nobody_longer_intervals" in numbers:
        most = text(numbers["nobody_longer_intervals"])
        rows.append(("no policy's first node later", most, "", *([""] if days else [])))
    columns = ("until", f"{numbers['policy']} [intervals]", "geometry alone")
    return Table("", (*columns, *(["days"] if days else [])), tuple(rows))


def _lines(case: _Case, wish: Wish) -> list[str]:
    rms = math.sqrt(case.bound_m2)
    lines = [
        f"{wish.sensors} sensors an interval of {case.interval_s:g} s, rms error of a snapshot at "
        f"most {rms:.3g} m; a battery is {case.battery:.4g} sensings:"
    ]
    simulated = float(np.asarray(case.field.battery))
    if case.battery > simulated:
        lines.append(f"  simulated with {simulated:.4g} sensings a node; intervals in proportion")
    return lines


def _doubts(case: _Case, ours: Lifetime, wish: Wish) -> list[str]:
    doubts: list[str] = []
    total = ours.served + ours.failed
    if ours.served and ours.first_death is None:
        doubts.append("no battery was empty after the passes that were simulated: - is not known")
    if ours.geometric:
        share = 100.0 * ours.geometric / total
        doubts.append(
            f"in {share:.3g} % of the intervals no {wish.sensors} sensors reach "
            f"{case.bound_m2:.3g} m^2, with full batteries either"
        )
    return doubts


def _figure(site: Site, ours: Lifetime, policy: str) -> Figure:
    from trackfield.plotting.lifetimes import plot_lifetime

    return plot_lifetime(ours.history, title=f"{site.name}: {policy}", intervals=_INTERVALS)
