"""`trackfield reproduce`: a paper's tables and figures, beside ours."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Protocol

import typer

from trackfield.cli.output import Json, check_figure, check_folder, emit, progress, say, show_table
from trackfield.errors import ConfigurationError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from trackfield.experiments.results import Table

PAPERS = ("wang", "oh", "pham", "berger", "cheng")


class Reproduction(Protocol):
    """What a paper's experiments hand back."""

    @property
    def tables(self) -> tuple[Table, ...]:
        """Tables as they are shown."""
        ...

    @property
    def findings(self) -> tuple[str, ...]:
        """What was found, in sentences."""
        ...

    def to_dict(self) -> dict[str, object]:
        """Give everything as plain objects."""
        ...

    def figures(self) -> dict[str, Figure]:
        """Draw figures, by file name without its suffix."""
        ...


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
    with progress(f"reproducing {paper}") as moved:
        result = run(paper, seed, quick=quick, moved=moved)
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


def run(paper: str, seed: int, *, quick: bool, moved: Callable[[float], None]) -> Reproduction:
    """Run the experiments of a paper."""
    from numpy.random import default_rng

    from trackfield.experiments import berger, cheng, oh, pham, wang

    experiments = {
        "wang": wang.reproduce,
        "oh": oh.reproduce,
        "pham": pham.reproduce,
        "berger": berger.reproduce,
        "cheng": cheng.reproduce,
    }
    return experiments[paper](default_rng(seed), quick=quick, progress=moved)


def draw(result: Reproduction, folder: Path) -> list[Path]:
    """Write every figure of a reproduction into `folder`."""
    from trackfield.plotting.style import save

    paths: list[Path] = []
    for name, figure in result.figures().items():
        paths.append(folder / f"{name}.png")
        save(figure, paths[-1])
    return paths
