"""`trackfield plan`: what a site can do, who should sense next, and how long it lasts."""

from __future__ import annotations

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
    plot: Annotated[
        Path | None, typer.Option("--plot", metavar="FILE", help="Draw the answer.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Plan the work of SITE's sensors: what they can do, whom to ask, how long they last."""
    from trackfield.network.site_file import load_site

    asked = [name for name, given in (("--at", at),) if given is not None]
    if len(asked) > 1:
        raise ConfigurationError([f"found {' and '.join(asked)}, expected one question at a time"])
    if plot is not None:
        check_figure(plot)
        check_output(plot, [site])
    loaded = load_site(site)
    if at is not None:
        from trackfield.cli import plan_point

        answer = plan_point.answer(
            loaded, at, sensors=sensors, criterion=criterion, velocity=velocity
        )
    else:
        raise ConfigurationError(["expected a question"])
    tell(answer, plot, as_json=as_json)


def tell(answer: Answer, plot: Path | None, *, as_json: bool) -> None:
    """Draw, then print an answer."""
    if plot is not None and answer.figure is not None:
        from trackfield.plotting.style import save

        save(answer.figure(), plot)
    for doubt in answer.doubts:
        warn(doubt)
    if as_json:
        emit({**answer.numbers, "warnings": list(answer.doubts)})
        return
    for line in answer.lines:
        say(line)
    for table in answer.tables:
        show_table(table.columns, table.rows, title=table.title)
    if plot is not None:
        say(f"{plot}: drawn")
