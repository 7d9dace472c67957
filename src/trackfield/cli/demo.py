"""`trackfield demo`: the main job on a recorded robot, from its data to a table and a picture."""

from __future__ import annotations

import shlex
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from trackfield.cli.calibrate_ranges import calibrated
from trackfield.cli.output import check_figure, progress, say, show_table
from trackfield.cli.runs import Lag, Wanted
from trackfield.cli.score import COLUMNS, cells
from trackfield.cli.track_readings import draw, run_tracker

if TYPE_CHECKING:
    from trackfield.metrics.score import Score
    from trackfield.network.site import Site
    from trackfield.types import Tracks, Truth

LAG = Lag(seconds=2.0)


class Case(NamedTuple):
    """One way to track the run: what it is called, on which site, how late."""

    name: str
    site: Site
    lag: Lag
    tracks: Path


class Outcome(NamedTuple):
    """A case when it is done."""

    case: Case
    chunks: list[Tracks]
    score: Score


def demo(
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Where all files are put.")
    ] = Path("demo"),
) -> None:
    """Calibrate on one recorded run of a robot mower, track another, and score the tracks."""
    from trackfield.io.truth import read_truth

    picture = output / "plaza2.png"
    check_figure(picture)
    with progress("a recorded robot") as moved:
        for i, name in enumerate(("plaza1", "plaza2")):
            prepare(name, output / name)
            moved(0.1 * (i + 1))
        cases = prepare_cases(output)
        moved(0.4)
        truth = read_truth(output / "plaza2" / "truth.csv")
        outcomes: list[Outcome] = []
        for i, case in enumerate(cases):
            outcomes.append(run(case, output / "plaza2" / "measurements.csv", truth))
            moved(0.4 + 0.4 * (i + 1) / len(cases))
        draw(outcomes[-1].case.site, outcomes[-1].chunks, truth, picture)
        moved(1.0)
    title = "plaza2: a robot mower among four radios, 409 s; calibrated on plaza1"
    rows = [(outcome.case.name, *cells(outcome.score)) for outcome in outcomes]
    show_table(("tracked", *COLUMNS), rows, title=title)
    for outcome in outcomes:
        say(f"  {outcome.case.tracks}: tracks, {outcome.case.name}")
    say(f"  {picture}: sensors, truth, track with ellipses, error over time")
    say("Next, try:")
    for command in next_commands(output):
        say(f"  {command}")


def prepare(name: str, folder: Path) -> None:
    """Write a recording into `folder`, if it is not there already."""
    from trackfield.io.recorded import write_recorded

    if not (folder / "site.toml").is_file():  # the last file of a recording to be written
        write_recorded(name, folder)


def prepare_cases(output: Path) -> list[Case]:
    """Calibrate on plaza1, and say in which ways plaza2 is tracked."""
    from trackfield.network.site_file import load_site
    from trackfield.network.site_writer import write_site

    one, two = output / "plaza1", output / "plaza2"
    site = load_site(one / "site.toml")
    calibration, *_ = calibrated(site, one / "measurements.csv", one / "truth.csv", lambda _: None)
    file = two / "calibrated.toml"
    write_site(replace(calibration.site, name="plaza2"), file, comment="Calibrated on plaza1.")
    bare = load_site(two / "site.toml")
    raw = replace(bare, tracker=replace(bare.tracker, self_calibration=False))
    fitted = load_site(file)
    return [
        Case("raw", raw, Lag(), output / "plaza2_raw.csv"),
        Case("self-calibrating", bare, Lag(), output / "plaza2_self.csv"),
        Case("calibrated", fitted, Lag(), output / "plaza2_calibrated.csv"),
        Case("calibrated + lag 2 s", fitted, LAG, output / "plaza2_lag.csv"),
    ]


def run(case: Case, data: Path, truth: Truth) -> Outcome:
    """Track one case into its file, and score it."""
    from trackfield.metrics.score import score
    from trackfield.types import join_rows

    quiet: Callable[[float], None] = lambda _: None  # noqa: E731  one bar is for all
    wanted = Wanted(case.lag, keep=True)
    chunks = run_tracker(case.site, data, case.tracks, wanted=wanted, moved=quiet).kept
    return Outcome(case, chunks, score(truth, join_rows(chunks)))


def next_commands(output: Path) -> list[str]:
    """Three commands that go on from here, ready to be copied."""
    program = _program(Path(sys.argv[0]))
    one, two = shlex.quote(str(output / "plaza1")), shlex.quote(str(output / "plaza2"))
    return [
        f"{program} check {two}/site.toml {two}/measurements.csv",
        f"{program} track {one}/site.toml {one}/measurements.csv -o {one}/tracks.csv "
        f"--plot {one}/tracks.png --truth {one}/truth.csv",
        f"{program} reproduce wang --quick",
    ]


def _program(running: Path) -> str:
    """How the program that is running can be called again from here."""
    if running.name == "__main__.py":
        return "python -m trackfield.cli"
    known = shutil.which("trackfield")
    if known is not None and running.exists() and Path(known).samefile(running):
        return "trackfield"
    here = Path.cwd()
    return shlex.quote(str(running.relative_to(here) if running.is_relative_to(here) else running))
