"""Writes the pages of the reference that the program itself can say; `--check` only compares.

- `docs/reference/commands.md`: the help of every command.
- `docs/reference/python.md`: every public module, room by room.
- `docs/reference/site.schema.json`, `scenario.schema.json`: JSON Schemas of those files.
"""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

import trackfield
from trackfield.network.site_schema import site_schema
from trackfield.simulation.scenario_file import scenario_schema

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "trackfield"
REFERENCE = ROOT / "docs" / "reference"
WIDTH = 80

# Rooms in the order of the flow; those of modules that stand alone are named by the module.
ROOMS = (
    "api",
    "types",
    "errors",
    "sensing",
    "network",
    "localization",
    "filtering",
    "association",
    "hierarchy",
    "scheduling",
    "robot",
    "pursuit",
    "motion",
    "linalg",
    "matching",
    "raster",
    "pipeline",
    "calibration",
    "simulation",
    "metrics",
    "plotting",
    "io",
    "experiments",
)

COMMANDS_HEAD = """\
# Commands

<!-- Written by `make reference` from the program's own help. -->

Results are printed on standard output; progress, warnings and errors go to standard error, and
progress is shown on a terminal only. With `--json` a command prints one JSON object and nothing
else. Files are described in [](files.md), the site in [](site.md).

| exit code | meaning |
|---|---|
| 0 | done |
| 1 | the run or the check failed |
| 2 | wrong usage, configuration or input |
| 130 | interrupted |

"""


PYTHON_HEAD = """\
# Python

<!-- Written by `make reference` from the package's docstrings. -->

What most scripts need stands in `trackfield` itself; the rooms below it are for those who build
their own tracker of the parts. SI units everywhere; a state is positions first, then velocities.
[](../howto/python.md) shows them at work.

"""


def help_of(*arguments: str) -> str:
    """Help that `trackfield` prints with these arguments."""
    run = subprocess.run(  # noqa: S603  arguments are command names of the program itself
        [sys.executable, "-m", "trackfield.cli", *arguments, "--help"],
        env={**os.environ, "COLUMNS": str(WIDTH), "NO_COLOR": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    lines = [
        line.rstrip()
        for line in run.stdout.replace("python -m trackfield.cli", "trackfield")
        .strip("\n")
        .splitlines()
    ]
    return "\n".join(lines)


def commands_of(text: str) -> list[str]:
    """Names of the commands that a program's help lists."""
    _, _, listed = text.partition("Commands:\n")
    return [line.split()[0] for line in listed.splitlines() if line[:2] == "  " and line[2] != " "]


def commands_page() -> str:
    """Page with the help of the program and of every command."""
    program = help_of()
    page = COMMANDS_HEAD + f"```text\n{program}\n```\n"
    for command in commands_of(program):
        page += f"\n## {command}\n\n```text\n{help_of(command)}\n```\n"
    return page


def modules_of(room: str) -> list[str]:
    """Names of the public modules of a room, or of the module that is the room."""
    folder = PACKAGE / room
    if not folder.is_dir():
        return [f"trackfield.{room}"]
    files = sorted(path.stem for path in folder.glob("*.py"))
    return [f"trackfield.{room}.{name}" for name in files if not name.startswith("_")]


def python_page() -> str:
    """Page with the documentation of every public module."""
    page = PYTHON_HEAD + names_of_the_package()
    for room in ROOMS:
        if not (PACKAGE / room).is_dir():
            page += section("##", f"trackfield.{room}")
            continue
        about = ast.get_docstring(ast.parse((PACKAGE / room / "__init__.py").read_text()))
        page += f"\n## trackfield.{room}\n\n{about}\n"
        page += "".join(section("###", module) for module in modules_of(room))
    return page


def names_of_the_package() -> str:
    """Section with the names that `trackfield` itself offers."""
    rows = ""
    for name in (name for name in trackfield.__all__ if not name.startswith("_")):
        value = getattr(trackfield, name)
        promise = (value.__doc__ or "").strip().partition("\n")[0].replace("|", "\\|")
        rows += f"| {{py:obj}}`{name} <{value.__module__}.{name}>` | {promise} |\n"
    return f"## trackfield\n\n| name | what it is |\n|---|---|\n{rows}"


def section(marks: str, module: str) -> str:
    """Section of a page that holds the documentation of a module."""
    directive = f".. automodule:: {module}\n   :members:\n"
    return f"\n{marks} {module}\n\n```{{eval-rst}}\n{directive}```\n"


def main(arguments: list[str]) -> int:
    """Write the pages, or with `--check` say which ones are out of date; exit code."""
    pages = {
        REFERENCE / "commands.md": commands_page(),
        REFERENCE / "python.md": python_page(),
        REFERENCE / "site.schema.json": json.dumps(site_schema(), indent=2) + "\n",
        REFERENCE / "scenario.schema.json": json.dumps(scenario_schema(), indent=2) + "\n",
    }
    stale = [
        path
        for path, text in pages.items()
        if not path.exists() or path.read_text(encoding="utf-8") != text
    ]
    if "--check" in arguments:
        for path in stale:
            print(f"{path.name} is not what the program says; run: make reference")
        return 1 if stale else 0
    for path in stale:
        path.write_text(pages[path], encoding="utf-8")
        print(f"wrote {path.name}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
