"""`trackfield plan`: what a site can do, who should sense next, and how long it lasts."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackfield.cli.output import Json, check_figure, check_output, emit, say, show_table, warn
from trackfield.errors import ConfigurationError

if TYPE_CHECKING:
    from trackfield.cli.answers import Answer


def plan(
    site: Annotated[Path, typer.Argument(metavar="SITE", help="The site's file, TOML.")],
    at: Annotated[
        str | None,
        typer.Option("--at", metavar="X,Y", help="Who should sense a target there [m]."),
    ] = None,
    sensors: Annotated[
        int | None,
        typer.Option("-k", "--sensors", metavar="N", min=1, help="How many sense a target."),
    ] = None,
    criterion: Annotated[
        str, typer.Option("--criterion", metavar="A|D|E", help="What is optimal, with --at.")
    ] = "A",
    velocity: Annotated[
        str | None,
        typer.Option("--velocity", metavar="VX,VY", help="Of the target, with --at [m/s]."),
    ] = None,
    map_file: Annotated[
        Path | None,
        typer.Option("--map", metavar="FILE", help="Map of the error: picture, CSV, GeoJSON."),
    ] = None,
    cell: Annotated[
        float | None, typer.Option("--cell", metavar="M", help="Size of the map's cells [m].")
    ] = None,
    robot: Annotated[
        Path | None,
        typer.Option("--robot", metavar="TRUTH", help="Way of a robot that follows a target."),
    ] = None,
    start: Annotated[
        str | None, typer.Option("--start", metavar="X,Y", help="Of the robot [m].")
    ] = None,
    target: Annotated[
        str | None, typer.Option("--target", metavar="ID", help="Whom it follows; else the first.")
    ] = None,
    lifetime: Annotated[
        bool, typer.Option("--lifetime", help="For how long the field serves, target by target.")
    ] = False,
    policy: Annotated[
        str, typer.Option("--policy", metavar="NAME", help="How sets are chosen, with --lifetime.")
    ] = "learned",
    bound: Annotated[
        float | None,
        typer.Option("--bound", metavar="M2", min=1e-12, help="Of a snapshot's trace [m^2]."),
    ] = None,
    truth: Annotated[
        Path | None, typer.Option("--truth", metavar="TRUTH", help="Passes; else crossings.")
    ] = None,
    passes_per_day: Annotated[
        float | None, typer.Option("--passes-per-day", metavar="N", help="To tell days.")
    ] = None,
    clairvoyant: Annotated[
        bool, typer.Option("--clairvoyant", help="What no policy exceeds, too; slow.")
    ] = False,
    rms: Annotated[
        float | None,
        typer.Option("--rms", metavar="M", help="How many nodes are enough for an error [m]."),
    ] = None,
    layout: Annotated[
        str, typer.Option("--layout", help="hexagonal, square or random, with --rms.")
    ] = "hexagonal",
    seed: Annotated[int, typer.Option("--seed", metavar="N", min=0, help="Of all chance.")] = 0,
    plot: Annotated[
        Path | None, typer.Option("--plot", metavar="FILE", help="Draw the answer.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Plan the work of SITE's sensors: what they can do, whom to ask, how long they last."""
    from trackfield.cli import (
        plan_count,
        plan_field,
        plan_lifetime,
        plan_map,
        plan_point,
        plan_robot,
    )
    from trackfield.network.site_file import load_site

    questions = {
        "--at": at,
        "--map": map_file,
        "--robot": robot,
        "--lifetime": lifetime or None,
        "--rms": rms,
    }
    asked = [name for name, given in questions.items() if given is not None]
    if len(asked) > 1:
        raise ConfigurationError([f"found {' and '.join(asked)}, expected one question at a time"])
    _refuse_strays(
        asked[0] if asked else "",
        {
            "--at": {"--velocity": velocity},
            "--robot": {"--start": start, "--target": target},
            "--lifetime": {
                "--bound": bound,
                "--truth": truth,
                "--passes-per-day": passes_per_day,
                "--clairvoyant": clairvoyant or None,
            },
        },
    )
    if cell is not None and not 0.0 < cell < float("inf"):
        raise ConfigurationError([f"--cell: found {cell:g}, expected a size above 0 in metres"])
    if plot is not None and map_file is not None:
        raise ConfigurationError(["found --map and --plot, expected one of them: a map is drawn"])
    if plot is not None:
        check_figure(plot)
        check_output(plot, [site])
    loaded = load_site(site)
    if not loaded.sensor_ids:
        raise ConfigurationError([f"{site}: found no sensors, expected some whose work is planned"])
    if at is not None:
        answer = plan_point.answer(
            loaded, at, sensors=sensors, criterion=criterion, velocity=velocity
        )
    elif map_file is not None:
        plan_map.check_map(map_file, [site])
        answer = plan_map.answer(loaded, map_file, sensors=sensors, cell_m=cell)
    elif robot is not None:
        answer = plan_robot.answer(loaded, robot, start=start, target=target)
    elif lifetime:
        wish = plan_lifetime.Wish(
            policy, sensors or 3, bound, truth, passes_per_day, seed, clairvoyant
        )
        answer = plan_lifetime.answer(loaded, wish)
    elif rms is not None:
        answer = plan_count.answer(loaded, rms, layout=layout, seed=seed)
    else:
        answer = plan_field.answer(loaded, cell_m=cell)
    tell(answer, plot, as_json=as_json)


def _refuse_strays(asked: str, options: Mapping[str, Mapping[str, object]]) -> None:
    """Refuse options of questions that are not asked: their answer would not be the one meant."""
    strays = [
        f"{option}: found without {question}, which it belongs to"
        for question, own in options.items()
        for option, given in own.items()
        if given is not None and question != asked
    ]
    if strays:
        raise ConfigurationError(strays)


def tell(answer: Answer, plot: Path | None, *, as_json: bool) -> None:
    """Draw, then print an answer."""
    if plot is not None and answer.figure is not None:
        from trackfield.plotting.style import save

        save(answer.figure(), plot)
    for doubt in answer.doubts:
        warn(doubt)
    if as_json:
        emit({**answer.numbers, "warnings": list(answer.doubts)})
    else:
        for line in answer.lines:
            say(line)
        for table in answer.tables:
            show_table(table.columns, table.rows, title=table.title)
        if plot is not None and answer.figure is not None:
            say(f"{plot}: drawn")
    if answer.failed:
        raise typer.Exit(1)
