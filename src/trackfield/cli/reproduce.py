"""`trackfield reproduce`: a paper's tables and figures, beside ours."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trackfield.cli.output import Json, check_figure, check_folder, emit, progress, say, show_table
from trackfield.errors import ConfigurationError

if TYPE_CHECKING:
    from trackfield.experiments.wang import Reproduction

PAPERS = ("wang",)


def reproduce(
    paper: Annotated[str, typer.Argument(metavar="PAPER", help=f"Which: {', '.join(PAPERS)}.")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="DIR", help="Draw figures into it.")
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer runs: in seconds, with wider intervals.")
    ] = False,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Of all that is random.")] = 0,
    as_json: Json = False,
) -> None:
    """Run the experiments of PAPER: what it claims, what we find, and the bound."""
    if paper not in PAPERS:
        expected = ", ".join(PAPERS)
        raise ConfigurationError([f"PAPER: found {paper!r}, expected one of: {expected}"])
    if output is not None:
        check_figure(output / "figure.png")
        check_folder(output)
    from numpy.random import default_rng

    from trackfield.experiments.wang import reproduce as run

    with progress(f"reproducing {paper}") as moved:
        result = run(default_rng(seed), quick=quick, progress=moved)
    written = draw(result, output) if output is not None else []
    if as_json:
        emit({**result.to_dict(), "figures": [str(path) for path in written]})
        return
    for table in result.tables:
        show_table(table.columns, table.rows, title=table.title)
    for finding in result.findings:
        say(finding)
    for path in written:
        say(f"{path}: drawn")


def draw(result: Reproduction, folder: Path) -> list[Path]:
    """Write every figure of a reproduction into `folder`."""
    from trackfield.plotting.style import save

    paths: list[Path] = []
    for name, figure in result.figures().items():
        paths.append(folder / f"{name}.png")
        save(figure, paths[-1])
    return paths
