"""The program `trackfield`: its verbs, and what its exit codes mean.

0 done; 1 the run or check failed; 2 wrong usage, configuration or input; 130 interrupted.
Heavy imports stand inside the verbs, so that help is quick.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from io import StringIO
from typing import Annotated

import typer

from trackfield import __version__
from trackfield.cli import (
    calibrate,
    check,
    data,
    demo,
    plan,
    pursue,
    reproduce,
    score,
    simulate,
    track,
)
from trackfield.cli.output import RunError
from trackfield.errors import ConfigurationError, TrackfieldError

FAILED, REFUSED, INTERRUPTED = 1, 2, 130

app = typer.Typer(
    name="trackfield",
    help="Turn the readings of a field of cheap sensors into tracks.",
    no_args_is_help=True,
    rich_markup_mode=None,  # plain help: rich would double the time it takes
    pretty_exceptions_enable=False,
    add_completion=False,
)
app.command("track")(track.track)
app.command("calibrate")(calibrate.calibrate)
app.command("score")(score.score)
app.command("check")(check.check)
app.command("simulate")(simulate.simulate)
app.command("plan")(plan.plan)
app.command("pursue")(pursue.pursue)
app.command("data")(data.data)
app.command("reproduce")(reproduce.reproduce)
app.command("demo", hidden=True)(demo.demo)


def _say_version(wanted: bool) -> None:
    if wanted:
        sys.stdout.write(f"trackfield {__version__}\n")
        raise typer.Exit


@app.callback()
def _options(  # pyright: ignore[reportUnusedFunction]  typer keeps it
    _version: Annotated[
        bool,
        typer.Option("--version", callback=_say_version, is_eager=True, help="Say it and leave."),
    ] = False,
) -> None:
    pass


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `trackfield` with these arguments, or with those of the process; the exit code."""
    _open_streams()
    try:
        app(args=arguments, prog_name="trackfield")
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
    except KeyboardInterrupt:
        code = INTERRUPTED
    except RunError as error:
        code = _complain([str(error)], FAILED)
    except ConfigurationError as error:
        code = _complain(error.problems, REFUSED)
    except TrackfieldError as error:
        code = _complain([str(error)], REFUSED)
    except OSError as error:
        code = _complain([f"{error.filename or 'the system'}: {error.strerror}"], FAILED)
    else:
        code = 0
    if code == INTERRUPTED:
        sys.stderr.write("interrupted\n")
    return code


def _open_streams() -> None:
    """Talk to nobody where a caller closed an output: Python has None there."""
    sys.stdout = sys.stdout or StringIO()
    sys.stderr = sys.stderr or StringIO()


def _complain(problems: list[str], code: int) -> int:
    """Say on standard error what went wrong; hand back the exit code."""
    for problem in problems:
        sys.stderr.write(f"error: {problem}\n")
    return code
