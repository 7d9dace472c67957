"""Runs the reproductions in full and writes their tables and figures into the docs.

Takes some minutes; to be run after any change that moves numbers: `make papers`.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

PAPERS = Path(__file__).parents[1] / "docs" / "papers"

WANG_HEAD = """\
# Wang, Fu, Zhang: results

<!-- Written by `make papers`. -->

All of this is printed and drawn by `trackfield reproduce wang -o FOLDER`. Errors are RMSE per axis;
the intervals are 95 % over runs.

"""


def table(one: dict[str, Any]) -> str:
    """Markdown of a table of the reproduction."""
    columns: list[str] = one["columns"]
    lines = [columns, ["---"] * len(columns), *one["rows"]]
    text = "\n".join("| " + " | ".join(cell(value) for value in line) + " |" for line in lines)
    return f"## {one['title']}\n\n{text}\n\n"


def cell(value: str | float | None) -> str:
    """Text of a cell; a dash for what does not apply."""
    if value is None:
        return "-"
    return value if isinstance(value, str) else f"{value:.4g}"


def main() -> None:
    """Reproduce Wang's paper in full."""
    command = [sys.executable, "-m", "trackfield.cli", "reproduce", "wang", "--json", "-o"]
    folder = PAPERS / "wang"
    run = subprocess.run([*command, str(folder)], stdout=subprocess.PIPE, check=True)  # noqa: S603  the program itself
    result = json.loads(run.stdout)
    page = WANG_HEAD + "".join(table(one) for one in result["tables"])
    page += "## Findings\n\n" + "".join(f"- {finding}\n" for finding in result["findings"])
    page += "\n## Figures\n"
    for figure in result["figures"]:
        name = Path(figure).name
        page += f"\n![{Path(name).stem.replace('_', ' ')}](wang/{name})\n"
    (PAPERS / "wang_results.md").write_text(page, encoding="utf-8")
    print(f"wrote wang_results.md and {len(result['figures'])} figures")


if __name__ == "__main__":
    main()
