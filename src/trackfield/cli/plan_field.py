"""`trackfield plan SITE`: what the field can do as it stands."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from trackfield.cli.answers import Answer
from trackfield.cli.plan_map import (
    accuracy_doubts,
    accuracy_lines,
    accuracy_numbers,
    mapped,
    mirror_doubts,
    region_of,
)
from trackfield.experiments.results import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from trackfield.network.site import Site
    from trackfield.scheduling.accuracy import AccuracyMap

_CELLS = 60  # along the longer side
_TIMES = 4  # that a place is seen, at most, in the table
_DAY_S = 86400.0
_ACCEL_M_S2 = 0.5  # of a target of which none is told


def answer(site: Site, *, cell_m: float | None) -> Answer:
    """Tell accuracy, coverage, the way to the sinks, and how long batteries last in each mode."""
    found = mapped(site, cell_m=cell_m, cells=_CELLS)
    accuracy = accuracy_numbers(found)
    steady = _steady(site, found)
    coverage, covered = _coverage(site)
    network, doubts = _network(site)
    numbers: dict[str, Any] = {
        "sensors": len(site.sensor_ids),
        "accuracy": accuracy,
        "steady": steady,
        "coverage": coverage,
        "network": network,
        "battery_days": _days(site),
    }
    x_min, y_min, x_max, y_max = region_of(site)
    lines = [
        f"{site.name}: {len(site.sensor_ids)} sensors, {x_max - x_min:g} x {y_max - y_min:g} m"
    ]
    lines += ["one reading of each sensor in reach:", *accuracy_lines(accuracy)]
    lines += _steady_lines(steady)
    return Answer(
        numbers,
        lines,
        [*covered, _battery_table(site)],
        [*accuracy_doubts(accuracy), *mirror_doubts(site), *doubts],
        lambda: _figure(site, found),
    )


def _steady(site: Site, found: AccuracyMap) -> dict[str, Any]:
    """Error that tracking tends to where targets stay about a place, a reading of each an interval.

    None where it does not tend to any: a direction has no information.
    """
    from trackfield.scheduling.steady_error import steady_rms

    axes = np.stack([found.major_m.values, found.minor_m.values], axis=-1)
    there = found.determined.values > 0.0
    told = np.where(there[..., None], axes, np.inf) ** -2.0
    accel = site.target.accel_sigma_m_s2 or _ACCEL_M_S2
    step_s = site.scheduling.interval_s
    information = told[..., None] * np.eye(2)
    rms = steady_rms(information, step_s=step_s, accel_sigma_m_s2=accel)
    bounded = rms[np.isfinite(rms)]
    return {
        "interval_s": step_s,
        "accel_sigma_m_s2": accel,
        "bounded": float(bounded.size / rms.size),
        "rms_m": {
            "median": float(np.median(bounded)),
            "q95": float(np.quantile(bounded, 0.95)),
        }
        if bounded.size
        else None,
    }


def _steady_lines(steady: dict[str, Any]) -> list[str]:
    rms, share = steady["rms_m"], 100.0 * steady["bounded"]
    if rms is None:
        return []
    head = (
        f"tracked with one an interval of {steady['interval_s']:g} s, accelerations of "
        f"{steady['accel_sigma_m_s2']:g} m/s^2:"
    )
    return [
        head,
        f"  rms error in the long run: median {rms['median']:.3g} m, 95 % below {rms['q95']:.3g} m",
        f"  bounded in {share:.3g} % of the region",
    ]


def _coverage(site: Site) -> tuple[dict[str, Any] | None, list[Table]]:
    """Shares of the region that 1, 2, .. sensors see; None where their reach has no end."""
    from trackfield.localization.mixed_models import mixed, reach
    from trackfield.network.coverage import coverage
    from trackfield.network.holes import holes
    from trackfield.network.node_index import NodeIndex

    far = reach(mixed(site.models))
    if not np.isfinite(far).all():
        return None, []
    nodes, area = NodeIndex(site.positions[:, :2]), region_of(site)
    found = coverage(nodes, area, reach_m=far, times=_TIMES)
    gaps = holes(nodes, area, reach_m=far)
    told = {
        "share": found.share.tolist(),
        "least": found.least,
        "holes": [
            {"area_m2": hole.measure, "deepest_m": hole.deepest.tolist(), "gap_m": hole.gap_m}
            for hole in gaps
        ],
    }
    rows = tuple(
        (f"{times} or more", f"{100.0 * share:.1f} %")
        for times, share in enumerate(found.share.tolist(), 1)
    )
    return told, [Table("", ("seen by", "share of the region"), rows)]


def _network(site: Site) -> tuple[dict[str, Any] | None, list[str]]:
    """Hops to the leaders of groups, and who has no way there."""
    from trackfield.pipeline.scene import network_of

    network = network_of(site)
    if network is None:
        return None, []
    hops = network.routes.hops
    lost = [site.sensor_ids[int(i)] for i in network.cut_off]
    reached = hops[hops >= 0]
    told = {
        "cut_off": lost,
        "hops": {"mean": float(reached.mean()), "most": int(reached.max())}
        if reached.size
        else None,
    }
    some = ", ".join(lost[:5]) + (", ..." if len(lost) > 5 else "")
    doubt = f"found {len(lost)} sensors without a way to their leader, expected none: {some}"
    return told, [doubt] if lost else []


def _days(site: Site) -> dict[str, float | None]:
    """Days that a full battery lasts in each mode; None: for ever."""
    from trackfield.network.energy import mode_powers
    from trackfield.types import MODE_WORDS

    watts = 1e-3 * mode_powers(site.energy, site.scheduling.sensors)
    days = site.energy.battery_j / np.where(watts > 0.0, watts, np.nan) / _DAY_S
    return {
        word: float(day) if np.isfinite(day) else None
        for word, day in zip(MODE_WORDS, days, strict=True)
    }


def _battery_table(site: Site) -> Table:
    rows = tuple(
        (word, "for ever" if days is None else f"{days:.3g}") for word, days in _days(site).items()
    )
    return Table("", ("mode", "days on a battery"), rows)


def _figure(site: Site, found: AccuracyMap) -> Figure:
    from trackfield.plotting.plans import plot_map

    title = f"{site.name}: rms error, one reading of each sensor in reach"
    return plot_map(found, site.positions[:, :2], names=site.sensor_ids, title=title)
