"""`trackfield pursue`: a scenario's pursuers after its targets, and what came of it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trackfield.cli.output import (
    Json,
    check_output,
    emit,
    number,
    progress,
    say,
    show_table,
    warn,
)
from trackfield.errors import ConfigurationError

if TYPE_CHECKING:
    from trackfield.simulation.game_outcome import Outcome
    from trackfield.simulation.world import World

_TOLD = 5  # troubles, at most, that are told one by one


def pursue(
    scenario: Annotated[Path, typer.Argument(metavar="SCENARIO", help="A scenario's TOML file.")],
    seed: Annotated[
        int | None, typer.Option("--seed", min=0, help="Of all chance; else the scenario's own.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option("--plot", metavar="FILE", help="Draw the ways: .png, .svg, .pdf.")
    ] = None,
    animate: Annotated[
        Path | None,
        typer.Option("--animate", metavar="FILE", help="Play the pursuit: .html or .gif."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Let the pursuers of SCENARIO chase its targets.

    Sensors, network, tracker, coordinator and pursuers run in one loop: pursuers know what the
    tracker says, and a target is captured when a pursuer is really near it. The same scenario and
    seed give the same run.
    """
    from trackfield.simulation.game_outcome import played
    from trackfield.simulation.scenario_file import load_scenario
    from trackfield.simulation.world import doubts, make_world

    loaded = load_scenario(scenario)
    if loaded.pursuit is None:
        expected = "[pursuit] and [[pursuers]]"
        raise ConfigurationError([f"{scenario}: pursuit: found nothing, expected {expected}"])
    _check_pictures(scenario, plot, animate)
    world = make_world(loaded, seed=seed)
    with progress("pursuing") as moved:
        found = played(world, progress=moved)
    _draw(world, found, plot, animate)
    for line in (*doubts(world), *found.troubles[:_TOLD]):
        warn(line)
    if len(found.troubles) > _TOLD:
        warn(f"{len(found.troubles) - _TOLD} more of the kind")
    if as_json:
        emit(numbers(world, found))
    else:
        _show(world, found)
        for path in (plot, animate):
            if path is not None:
                say(f"{path}: drawn")


def numbers(world: World, found: Outcome) -> dict[str, Any]:
    """Numbers of a pursuit, for `--json`."""
    return {
        "scenario": world.scenario.name,
        "seed": world.seed,
        "steps": world.scenario.steps,
        "pursuers": len(world.scenario.pursuers),
        "evaders": len(found.fates),
        "captured": found.captured,
        "fates": [fate._asdict() for fate in found.fates],
        "apart_m": found.apart_m if math.isfinite(found.apart_m) else None,
        "clear_m": found.clear_m if math.isfinite(found.clear_m) else None,
        "collisions": found.collisions,
        "orders": found.counts,
        "troubles": list(found.troubles),
    }


def _show(world: World, found: Outcome) -> None:
    rows = [
        (
            fate.target,
            number(fate.from_s, 1),
            number(fate.chased_s, 1),
            number(fate.expected_s, 1),
            number(fate.captured_s, 1),
            "-" if fate.pursuer is None else str(fate.pursuer),
        )
        for fate in found.fates
    ]
    columns = ("evader", "came [s]", "chased [s]", "expected [s]", "captured [s]", "by pursuer")
    count = len(world.scenario.pursuers)
    say(f"{world.scenario.name}: {found.captured} of {len(found.fates)} captured by {count}")
    show_table(columns, rows)
    apart = f"{found.apart_m:.2f} m" if math.isfinite(found.apart_m) else "-"
    clear = f"{found.clear_m:.2f} m" if math.isfinite(found.clear_m) else "-"
    say(f"  least distance between pursuers {apart}, to obstacles {clear}")
    say(
        f"  {found.collisions} steps nearer than allowed; {found.counts['changed']} changes of mind"
    )


def _check_pictures(scenario: Path, plot: Path | None, animate: Path | None) -> None:
    """Refuse, before the work, pictures that could not be written after it."""
    if plot is not None:
        from trackfield.plotting.style import kind_of

        kind_of(plot)
        check_output(plot, [scenario])
    if animate is not None:
        from trackfield.plotting.animation import animation_kind

        animation_kind(animate)
        check_output(animate, [scenario, plot])


def _draw(world: World, found: Outcome, plot: Path | None, animate: Path | None) -> None:
    if plot is None and animate is None:
        return
    from trackfield.plotting.many import Scenery
    from trackfield.plotting.pursuits import Chase, as_tracks, known_places, plot_pursuit

    places = {name: place for place, name in enumerate(found.truth.target_ids)}
    chase = Chase(
        found.t_s,
        found.paths,
        found.truth,
        found.tracks,
        tuple(
            (places[fate.target], fate.captured_s, fate.pursuer)
            for fate in found.fates
            if fate.captured_s is not None and fate.pursuer is not None
        ),
        tuple(shape.corners for shape in world.scenario.obstacles),
    )
    sensors = world.deployment.told if world.deployment.sensor_ids else None
    scenery = Scenery(world.scenario.area, sensors, known_places(found.tracks), found.truth)
    title = f"{world.scenario.name}: {found.captured} of {len(found.fates)} captured"
    if plot is not None:
        from trackfield.plotting.style import save

        save(plot_pursuit(chase, scenery, title=title), plot)
    if animate is not None:
        from trackfield.plotting.animation import save_animation

        save_animation(as_tracks(chase), animate, scenery=scenery, title=title)
