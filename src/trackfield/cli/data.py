"""`trackfield data`: recorded runs from installed packages, in our files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from trackfield.cli.output import Json, emit, say


def data(
    name: Annotated[str, typer.Argument(metavar="NAME", help="A recorded run: plaza1, plaza2.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="The folder to write it into.")
    ],
    as_json: Json = False,
) -> None:
    """Write the recorded run NAME: its site, readings and truth."""
    from trackfield.io.recorded import write_recorded

    write_recorded(name, output)
    files = sorted(path.name for path in output.iterdir() if path.is_file())
    if as_json:
        emit({"folder": str(output), "files": files})
    else:
        say(f"{output}: {', '.join(files)}")
