"""What verbs say: results on standard output, progress and warnings on standard error."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from trackfield.errors import ConfigurationError, InputError, TrackfieldError

Json = Annotated[bool, typer.Option("--json", help="Print one JSON object, and nothing else.")]


class RunError(TrackfieldError):
    """The input was sound and the run still came to nothing; exit 1."""


def say(text: str) -> None:
    """Tell a result."""
    sys.stdout.write(f"{text}\n")


def warn(text: str) -> None:
    """Tell of what may be wrong."""
    sys.stderr.write(f"warning: {text}\n")


def emit(result: Mapping[str, Any]) -> None:
    """Print the one object of `--json`."""
    sys.stdout.write(json.dumps(result, allow_nan=False) + "\n")


def show_table(columns: Sequence[str], rows: Sequence[Sequence[str]], *, title: str = "") -> None:
    """Print a table; all columns but the first are flush right."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=SIMPLE_HEAD, collapse_padding=True, title_justify="left")
    table.title = Text(title) if title else None  # as Text: what stands in [] is no style
    for i, column in enumerate(columns):
        table.add_column(Text(column), justify="right" if i else "left", no_wrap=True)
    for row in rows:
        table.add_row(*map(Text, row))
    width = None if sys.stdout.isatty() else 400  # a file has no width: cut nothing
    Console(file=sys.stdout, highlight=False, width=width).print(table)


def number(value: float | None, digits: int = 3) -> str:
    """Write a number of a table; a dash for one that is not known."""
    return "-" if value is None else f"{value:.{digits}f}"


def check_output(path: Path, inputs: Sequence[Path | None]) -> None:
    """Refuse, before the work, a file that could not be written after it or is one of `inputs`."""
    from trackfield.io.output import check_writable

    if any(one is not None and _same(path, one) for one in inputs):
        problem = f"{path}: found an input, expected another file to write to"
        raise ConfigurationError([problem])
    check_writable(path)


def _same(path: Path, other: Path) -> bool:
    return path.exists() and other.exists() and path.samefile(other)


def check_folder(path: Path) -> None:
    """Make a folder for results, unless there is one; refused before the work."""
    from trackfield.io.output import check_writable, saying

    with saying(path):
        path.mkdir(parents=True, exist_ok=True)
    check_writable(path / "file")


@contextmanager
def naming(*files: Path) -> Generator[None]:
    """Put the names of `files` before an `InputError` that came from what is in them.

    One that begins with the name of one of them says where it came from itself.
    """
    try:
        yield
    except InputError as error:
        if str(error).startswith(tuple(map(str, files))):
            raise
        raise InputError(f"{', '.join(map(str, files))}: {error}") from None


@contextmanager
def progress(what: str) -> Generator[Callable[[float], None]]:
    """Show a bar on standard error while the block runs, moved by calls with shares 0 to 1.

    Without a terminal there is none.
    """
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        console=Console(stderr=True),
        transient=True,
    ) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda share: bar.update(task, completed=share)


def check_animation(path: Path) -> None:
    """Refuse, before the work, an animation that could not be written after it."""
    with _drawing(path):
        from trackfield.plotting.animation import animation_kind

        animation_kind(path)


def check_figure(path: Path) -> None:
    """Refuse, before the work, a figure that could not be written after it."""
    with _drawing(path):
        from trackfield.plotting.style import kind_of

        kind_of(path)


@contextmanager
def _drawing(path: Path) -> Generator[None]:
    """Say what to install where Matplotlib is missing."""
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name != "matplotlib":
            raise
        problem = f"{path}: drawing needs Matplotlib; install trackfield[plot]"
        raise ConfigurationError([problem]) from None
