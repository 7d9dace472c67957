"""Runs the reproductions in full and writes their tables and figures into the docs.

Takes a quarter of an hour; to be run after any change that moves numbers: `make papers`, or
`python scripts/papers.py wang` for one.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

PAPERS = Path(__file__).parents[1] / "docs" / "papers"

HEADS = {
    "wang": """\
# Wang, Fu, Zhang: results

<!-- Written by `make papers`. -->

All of this is printed and drawn by `trackfield reproduce wang -o FOLDER`. Errors are RMSE per axis;
the intervals are 95 % over runs.

""",
    "oh": """\
# Oh, Schenato, Chen, Sastry: results

<!-- Written by `make papers`. -->

All of this is printed and drawn by `trackfield reproduce oh -o FOLDER`. In brackets are 95 %
intervals over scans, worlds or runs, by bootstrap.

""",
    "pham": """\
# Pham: results

<!-- Written by `make papers`. -->

All of this is printed and drawn by `trackfield reproduce pham -o FOLDER`. Where two numbers stand
side by side, the first one is the paper's.

""",
    "berger": """\
# Berger, Choi, Zhou, Willett: results

<!-- Written by `make papers`. -->

All of this is printed and drawn by `trackfield reproduce berger -o FOLDER`. Lengths are in
kilometres, as in the paper; SNR is that at 1 km.

""",
    "cheng": """\
# Cheng, Ghosh, Hu: results

<!-- Written by `make papers`. -->

All of this is printed and drawn by `trackfield reproduce cheng -o FOLDER`.

""",
}


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


def main(papers: Sequence[str]) -> int:
    """Reproduce the papers that are named, or all, in full."""
    for paper in papers or HEADS:
        if paper not in HEADS:
            print(
                f"papers.py: found {paper!r}, expected some of: {', '.join(HEADS)}", file=sys.stderr
            )
            return 2
        reproduce(paper)
    return 0


def reproduce(paper: str) -> None:
    """Run one paper's experiments and write its page and figures."""
    folder = PAPERS / paper
    command = [sys.executable, "-m", "trackfield.cli", "reproduce", paper, "--json", "-o"]
    run = subprocess.run([*command, str(folder)], stdout=subprocess.PIPE, check=True)  # noqa: S603  the program itself
    result = json.loads(run.stdout)
    page = HEADS[paper] + "".join(table(one) for one in result["tables"])
    page += "## Findings\n\n" + "".join(f"- {finding}\n" for finding in result["findings"])
    page += "\n## Figures\n"
    for figure in result["figures"]:
        name = Path(figure).name
        page += f"\n![{Path(name).stem.replace('_', ' ')}]({paper}/{name})\n"
    (PAPERS / f"{paper}_results.md").write_text(page, encoding="utf-8")
    print(f"wrote {paper}_results.md and {len(result['figures'])} figures")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
