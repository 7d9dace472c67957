"""Pages of the documentation and the blocks of code in them.

A fence may name a file after its language (```toml site.toml): the block is that file.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"


class Block(NamedTuple):
    """A fenced block: where its first line of code stands, its language, the file it names."""

    page: Path
    line: int
    language: str
    file: str
    code: str


def pages() -> list[Path]:
    """README and every page of the documentation, in order."""
    built = DOCS / "_build"
    return [ROOT / "README.md", *sorted(p for p in DOCS.rglob("*.md") if built not in p.parents)]


def title(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def blocks(page: Path) -> list[Block]:
    """Fenced blocks of a page in order; an open one is closed by the page's end."""
    found: list[Block] = []
    fence, info, start, code = "", "", 0, list[str]()
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
        if fence:
            if line.strip() == fence:
                language, _, file = info.partition(" ")
                found.append(Block(page, start, language, file, "\n".join(code) + "\n"))
                fence = ""
            else:
                code.append(line)
        elif opened := re.match(r"\s*(`{3,}|:{3,})(.*)$", line):
            fence, info, start, code = opened[1], opened[2].strip(), number + 1, []
    return found
