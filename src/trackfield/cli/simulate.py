"""`trackfield simulate`: a scenario to a site, readings or reports, and truth."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from trackfield.cli.output import Json, check_folder, check_output, emit, progress, say, warn

if TYPE_CHECKING:
    from trackfield.network.meter import Meter
    from trackfield.network.passage import Passed
    from trackfield.network.site import SchedulingSettings
    from trackfield.simulation.world import World
    from trackfield.types import Columns, Commands

LOSSES = ("lost", "delayed", "garbled", "silent")
COLUMNS = {
    "measurements.csv": ("t_s", "sensor_id", "kind", "value"),
    "reports.csv": ("t_s", "x_m", "y_m"),
}


class Said(NamedTuple):
    """A file of what was said: its rows, and what became of messages on the way."""

    name: str
    rows: int
    messages: dict[str, int]


def simulate(
    scenario: Annotated[Path, typer.Argument(metavar="SCENARIO", help="A scenario's TOML file.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="The folder to write into.")
    ],
    seed: Annotated[
        int | None, typer.Option("--seed", min=0, help="Of all chance; else the scenario's own.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Simulate SCENARIO: write its site, readings or reports, and truth.

    The same scenario and seed give the same files. With [scheduling], sensors measure only while
    they are told to, in closed loop with a tracker: what they were told and what they spent is
    written too.
    """
    from trackfield.io.truth import write_truth
    from trackfield.simulation.scenario_file import load_scenario
    from trackfield.simulation.world import doubts, make_world

    loaded = load_scenario(scenario)
    check_folder(output)
    names = ["measurements.csv"] if loaded.reports is None else []
    names += ["reports.csv"] if loaded.reports is not None or loaded.fusion is not None else []
    looped = ("commands.csv", "energy.csv") if loaded.scheduling is not None else ()
    for name in (*names, *looped, "truth.csv", "sensors.csv", "site.toml"):
        check_output(output / name, [scenario])
    world = make_world(loaded, seed=seed)
    with progress("simulating") as moved:
        if loaded.scheduling is not None:
            commanded = write_commanded(world, loaded.scheduling, output, moved)
            said, looped_numbers = [commanded.said], {"closed_loop": commanded.numbers}
        else:
            said = [
                write_said(world, output / name, lambda share, i=i: moved((i + share) / len(names)))
                for i, name in enumerate(names)
            ]
            looped_numbers = {}
    write_truth(output / "truth.csv", world.truth)
    write_site_files(world, output)
    result = {**summary(world, said), **looped_numbers}
    for line in doubts(world):
        warn(line)
    if as_json:
        emit({"folder": str(output), **result})
    else:
        show(output, result)


def write_said(world: World, path: Path, moved: Callable[[float], None]) -> Said:
    """Write readings or reports as they come, and count them."""
    from trackfield.io.writing import write_tables
    from trackfield.simulation.hearing import hear_readings, hear_reports

    is_readings = path.name == "measurements.csv"
    names = columns_of(world, path.name)
    rows: list[int] = []
    counts: list[Passed] = []

    def tables() -> Iterator[Columns]:
        for table, passed, until_s in hear_readings(world) if is_readings else hear_reports(world):
            columns = table.columns()
            yield {name: columns[name] for name in names}
            rows.append(len(table))
            counts.append(passed)
            moved(min(until_s / world.scenario.duration_s, 1.0))

    write_tables(path, tables())
    return Said(path.name, sum(rows), functools.reduce(lambda a, b: a.plus(b), counts)._asdict())


def columns_of(world: World, name: str) -> tuple[str, ...]:
    """Columns of a file of what is said."""
    from trackfield.simulation.hearing import tells_arrivals

    is_readings = name == "measurements.csv"
    names = COLUMNS[name]
    if world.scenario.tagged:
        names = (*names, "target_id")
    if tells_arrivals(world, "readings" if is_readings else "reports"):
        names = (*names, "arrival_s")
    return (*names, "sigma_m") if world.scenario.fusion == "fit" and not is_readings else names


class Commanded(NamedTuple):
    """A run in closed loop: what was said in it, and its numbers."""

    said: Said
    numbers: dict[str, Any]


def write_commanded(
    world: World, settings: SchedulingSettings, folder: Path, moved: Callable[[float], None]
) -> Commanded:
    """Write what sensors say while they are told to, what they are told and what they spend."""
    from trackfield.io.commands import write_commands
    from trackfield.io.energy import write_energy
    from trackfield.io.writing import write_tables
    from trackfield.simulation.closed_loop import nothing, tallied
    from trackfield.simulation.commanded import WorldSenses, run_commanded
    from trackfield.simulation.told_site import site_of
    from trackfield.types import MODE_WORDS, join_rows

    site, senses = site_of(world), WorldSenses(world, settings)
    names = columns_of(world, "measurements.csv")
    if settings.burst > 1:
        names = (*names, "sigma")
    found, rows, orders, meters = nothing(), 0, list["Commands"](), list["Meter"]()

    def tables() -> Iterator[Columns]:
        nonlocal found, rows
        for turn in run_commanded(world, senses):
            columns = turn.readings.columns()
            yield {name: columns[name] for name in names}
            rows += len(turn.readings)
            orders.append(turn.commands)
            meters[:] = [turn.meter]
            found = tallied(found, turn, site)
            moved(min(turn.meter.t_s / world.scenario.duration_s, 1.0))

    write_tables(folder / "measurements.csv", tables())
    write_commands(folder / "commands.csv", join_rows(orders))
    write_energy(folder / "energy.csv", meters[0])
    in_mode = found.in_mode_s / found.duration_s
    numbers = {
        "tracked_s": found.tracked_s,
        "spent_j": found.spent_j,
        "above_sleep_j": found.above_sleep_j,
        "above_sleep_j_per_tracked_s": found.per_tracked_s,
        "nodes": dict(zip(MODE_WORDS, in_mode.tolist(), strict=True)),
        **found.counts,
        "troubles": list(found.troubles),
    }
    return Commanded(Said("measurements.csv", rows, senses.passed._asdict()), numbers)


def write_site_files(world: World, folder: Path) -> None:
    """Write site.toml, and sensors.csv if there are sensors."""
    from trackfield.io.writing import write_table
    from trackfield.network.site_writer import write_site
    from trackfield.simulation.told_site import sensor_columns, site_of

    file = folder / "sensors.csv" if world.deployment.sensor_ids else None
    if file is not None:
        write_table(file, sensor_columns(world))
    comment = f"Simulated: {world.scenario.name}, seed {world.seed}."
    write_site(site_of(world, sensors_file=file), folder / "site.toml", comment=comment)


def summary(world: World, said: Sequence[Said]) -> dict[str, Any]:
    """Numbers of a simulated world, for `--json`."""
    deployment, scenario = world.deployment, world.scenario
    names, alive = deployment.sensor_ids, deployment.network.alive
    return {
        "scenario": scenario.name,
        "seed": world.seed,
        "duration_s": scenario.duration_s,
        "steps": scenario.steps,
        "targets": len(world.truth.target_ids),
        "truth_rows": len(world.truth),
        "sensors": len(names),
        "dead": [name for place, name in enumerate(names) if not alive[place]],
        "cut_off": [names[int(place)] for place in deployment.network.cut_off],
        "files": {one.name: {"rows": one.rows, "messages": one.messages} for one in said},
    }


def show(output: Path, result: Mapping[str, Any]) -> None:
    """Tell what was written."""
    say(f"{output}: {result['scenario']}, {result['steps']} steps")
    say(f"  truth.csv: {result['targets']} targets, {result['truth_rows']} rows")
    if result["sensors"]:
        say(f"  sensors.csv: {result['sensors']} sensors, {len(result['dead'])} of them dead")
    for name, file in result["files"].items():
        messages = file["messages"]
        told = [f"{messages['sent']} sent"]
        told += [f"{count} {what}" for what, count in messages.items() if count and what in LOSSES]
        say(f"  {name}: {file['rows']} rows" + (f"; {', '.join(told)}" if len(told) > 1 else ""))
    if "closed_loop" in result:
        show_loop(result["closed_loop"])
    say("  site.toml: what a tracker is told")


def show_loop(numbers: Mapping[str, Any]) -> None:
    """Tell what a closed loop came to."""
    nodes = ", ".join(f"{count:.1f} {word}" for word, count in numbers["nodes"].items())
    say(f"  commands.csv: {numbers['commands']} changes of modes; on average {nodes}")
    say(
        f"  energy.csv: {numbers['spent_j']:.4g} J, {numbers['above_sleep_j']:.4g} J of it above "
        f"sleep; {numbers['above_sleep_j_per_tracked_s']:.4g} J for each of "
        f"{numbers['tracked_s']:.4g} s in which a target was tracked"
    )
