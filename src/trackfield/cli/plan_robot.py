"""`trackfield plan SITE --robot TRUTH`: the way of a robot that follows a target."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from trackfield.cli.answers import Answer
from trackfield.cli.plan_map import region_of
from trackfield.cli.plan_point import check_places, numbers_of
from trackfield.errors import ConfigurationError, InputError
from trackfield.experiments.results import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from trackfield.network.site import Site
    from trackfield.robot.plan import Mission, Plan
    from trackfield.robot.rule import Link
    from trackfield.types import Matrix, Vector


def answer(site: Site, truth: Path, *, start: str | None, target: str | None) -> Answer:
    """Lead the site's robot after a target of TRUTH, from `start` or where it is first seen."""
    from trackfield.robot.plan import plan

    t_s, track, name = _track(truth, target)
    begin = track[0] if start is None else numbers_of("--start", start, 2)
    mission = _mission(site)
    found = plan(mission, t_s, track, start=begin)
    sink = _to_sink(site, found)
    numbers = {
        "target": name,
        "samples": len(t_s),
        "reach_m": mission.link.reach_m,
        "length_m": found.length_m,
        "rule_m": found.rule_m,
        "optimum_m": found.optimum_m,
        "optimum_is_at_least_m": found.bound_m,
        "hop_kept": found.hop_kept,
        "lost_s": found.lost_s,
        "longest_lost_s": found.longest_lost_s,
        "needed_speed_m_s": found.needed_speed_m_s
        if math.isfinite(found.needed_speed_m_s)
        else None,
        "too_slow": found.too_slow,
        "unreachable_steps": int(np.sum(~found.path.reachable)),
        "hops_to_sink": sink,
        "path_m": found.path.place.tolist(),
    }
    return Answer(
        numbers,
        _lines(mission.link, found, name, sink),
        [_table(found)],
        _doubts(mission, found),
        lambda: _figure(site, mission, track, found),
        failed=found.hop_kept < 1.0,
    )


def _track(truth: Path, target: str | None) -> tuple[Vector, Matrix, str]:
    """Read times, places (n, 2) and the name of whom to follow: `target`, or the first one."""
    from trackfield.io.truth import read_truth

    table = read_truth(truth)
    names = table.target_ids
    if target is not None and target not in names:
        from trackfield.network.faults import nearest

        known = f"a target of {truth}; {nearest(target, names)}"
        raise ConfigurationError([f"--target: found {target!r}, expected {known}"])
    name = names[0] if target is None else target
    own = table.target == names.index(name)
    check_places(truth, table.position[own, :2])
    t_s, first = np.unique(table.t_s[own], return_index=True)
    return t_s, table.position[own][first, :2], name


def _mission(site: Site) -> Mission:
    from trackfield.localization.mixed_models import mixed, reach
    from trackfield.robot.car import Car
    from trackfield.robot.horizon import Horizon
    from trackfield.robot.obstacles import Obstacles
    from trackfield.robot.plan import Mission
    from trackfield.robot.rule import Link
    from trackfield.robot.vehicle import Vehicle

    robot = site.robot
    comm = robot.comm_m or (site.network.hop_m if site.network is not None else None)
    far = reach(mixed(site.models))
    sensing = robot.sensing_m or float(far.max())
    problems: list[str] = []
    if comm is None:
        problems.append(
            "robot.comm_m: found nothing and no network.hop_m, expected a hop in metres"
        )
    if not math.isfinite(sensing):
        problems.append(
            "robot.sensing_m: found nothing and sensors without an end to their range, expected "
            "how far they sense in metres"
        )
    if robot.wheel_base_m is not None and not math.isfinite(robot.max_speed_m_s):
        problems.append("robot.max_speed_m_s: found nothing, expected the speed of the car")
    if comm is None or problems:
        raise ConfigurationError([f"site {site.name}: {problem}" for problem in problems])
    car = None
    if robot.wheel_base_m is not None:
        steering = math.radians(robot.max_steering_deg)
        car = Car(robot.max_speed_m_s, steering, robot.wheel_base_m)
    obstacles = Obstacles(_polygons(site), margin_m=robot.radius_m)
    return Mission(
        Link(comm, sensing, robot.error_m),
        Vehicle(robot.max_speed_m_s, car=car, obstacles=obstacles),
        Horizon(region=region_of(site)),
    )


def _polygons(site: Site) -> list[Matrix]:
    """Corners (m, 2) [m] of the site's obstacles; one that is no simple polygon is named."""
    from trackfield.robot.convex_parts import parts_of

    polygons: list[Matrix] = [np.array(obstacle.polygon) for obstacle in site.obstacles]
    problems: list[str] = []
    for number, polygon in enumerate(polygons, 1):
        try:
            parts_of(polygon)
        except InputError as error:
            problems.append(f"site {site.name}: obstacles[{number}].polygon: {error}")
    if problems:
        raise ConfigurationError(problems)
    return polygons


def _to_sink(site: Site, found: Plan) -> dict[str, Any] | None:
    """Hops from the robot to the nearest leader of a group, over the nodes; None without any."""
    if site.network is None or not site.groups:
        return None
    from trackfield.robot.sink import relays, route

    places = found.path.place
    least: Vector = np.full(len(places), np.inf)
    for group in site.groups:
        sink = np.array([group.x_m, group.y_m])
        net = relays(site.positions[:, :2], sink, hop_m=site.network.hop_m)
        hops = route(net, places).hops
        least = np.minimum(least, np.where(hops < 0, np.inf, hops))
    heard = np.isfinite(least)
    return {
        "mean": float(least[heard].mean()) if heard.any() else None,
        "most": int(least[heard].max()) if heard.any() else None,
        "cut_off_steps": int(np.sum(~heard)),
    }


def _lines(link: Link, found: Plan, name: str, sink: dict[str, Any] | None) -> list[str]:
    lines = [
        f"following {name} over {len(found.t_s)} samples, never more than {link.reach_m:g} m away:",
        f"  a hop was kept in {100.0 * found.hop_kept:.4g} % of the samples",
    ]
    if sink is not None and sink["mean"] is not None:
        lines.append(f"  to the sink: {sink['mean']:.2f} hops on average, {sink['most']} at most")
    return lines


def _table(found: Plan) -> Table:
    best = found.optimum_m

    # Who lags behind goes a shorter way, not a better one.
    known = found.hop_kept >= 1.0 and best > 0.0

    def row(what: str, length: float) -> tuple[str, ...]:
        return (what, f"{length:.2f}", f"{length / best:.3f}" if known else "-")

    rows = (
        row("looking ahead", found.length_m),
        row("rule (4.11)", found.rule_m),
        row("shortest there is, without obstacles or limits", best),
    )
    return Table("", ("way", "length [m]", "over the shortest"), rows)


def _doubts(mission: Mission, found: Plan) -> list[str]:
    doubts: list[str] = []
    if found.too_slow and not math.isfinite(found.needed_speed_m_s):
        doubts.append("--start: found a place out of reach of the target when it is first seen")
    elif found.too_slow:
        doubts.append(
            f"robot.max_speed_m_s: found {mission.vehicle.speed_m_s:g} m/s, expected at least "
            f"{found.needed_speed_m_s:.3g}: no slower robot keeps the hop on this way"
        )
    if found.hop_kept < 1.0:
        doubts.append(
            f"the hop was lost for {found.lost_s:.3g} s, {found.longest_lost_s:.3g} s at once, "
            f"by up to {float(found.path.behind_m.max()):.3g} m"
        )
    blocked = int(np.sum(~found.path.reachable))
    if blocked:
        doubts.append(f"obstacles left no way into reach in {blocked} samples")
    return doubts


def _figure(site: Site, mission: Mission, track: Matrix, found: Plan) -> Figure:
    from trackfield.plotting.robots import Chase, plot_chase

    chase = Chase(
        track,
        found.path.place,
        mission.link.reach_m,
        nodes=site.positions[:, :2],
        obstacles=[np.array(obstacle.polygon) for obstacle in site.obstacles],
        late=found.late_steps.tolist(),
    )
    return plot_chase(chase, title=f"{site.name}: {found.length_m:.1f} m")
