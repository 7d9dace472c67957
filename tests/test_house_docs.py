"""Every block of code in README and docs runs, page by page, in the order of the page.

- python: executed; blocks of a page share their names. With `>>>` it is a doctest.
- console: lines with `$ ` are run; what stands below one must be its output (`...` for anything).
  `# exit 2` at the end of a command says that it must fail so.
- toml, json, csv: written as the file that the fence names, or only parsed.
- text: shown to people, not run. Other languages are refused, so that nothing hides in them.
"""

from __future__ import annotations

import csv
import doctest
import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from pages import DOCS, ROOT, Block, blocks, pages, title

# What sets a machine up: not run, but its targets and extras must exist.
SET_UP = re.compile(r"(git clone|cd|make|pip install) ")
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
DIRECTIVES = re.compile(r"\{[a-z-]+\}")
PROGRAM = f'trackfield() {{ "{sys.executable}" -m trackfield.cli "$@"; }}; '


def where(block: Block) -> str:
    return f"{title(block.page)}:{block.line}"


def run_console(block: Block, folder: Path) -> None:
    commands: list[tuple[str, list[str]]] = []
    for line in block.code.splitlines():
        if line.startswith("$ "):
            commands.append((line[2:], []))
        elif commands:
            commands[-1][1].append(line)
        else:
            pytest.fail(f"{where(block)}: a console block begins with '$ '")
    for command, shown in commands:
        if SET_UP.match(command):
            check_set_up(block, command)
        else:
            run_command(block, command, "\n".join(shown), folder)


def run_command(block: Block, command: str, shown: str, folder: Path) -> None:
    expected = int(found[1]) if (found := re.search(r"# exit (\d+)$", command)) else 0
    run = subprocess.run(
        ["bash", "-c", PROGRAM + command],
        check=False,
        cwd=folder,
        env={**os.environ, "COLUMNS": "100", "NO_COLOR": "1", "MPLBACKEND": "Agg"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=300,
    )
    assert run.returncode == expected, f"{where(block)}: $ {command}\n{run.stdout}"
    if shown.strip():
        same = doctest.OutputChecker().check_output(shown, run.stdout, FLAGS)
        assert same, f"{where(block)}: $ {command}\nshown:\n{shown}\nprinted:\n{run.stdout}"


def check_set_up(block: Block, command: str) -> None:
    """Targets of make exist, and so do the extras that pip is asked for."""
    word, _, rest = command.partition(" ")
    if word == "make":
        targets = re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
        assert rest.split()[0] in targets, f"{where(block)}: no such target: {command}"
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    for name in ",".join(re.findall(r"\[(.*?)\]", rest)).split(","):
        assert not name or name.strip() in extras, f"{where(block)}: no such extra: {command}"


def run_python(block: Block, names: dict[str, object]) -> None:
    if ">>> " in block.code:
        test = doctest.DocTestParser().get_doctest(
            block.code, names, where(block), title(block.page), block.line
        )
        said: list[str] = []
        runner = doctest.DocTestRunner(optionflags=FLAGS, verbose=False)
        failed = runner.run(test, out=said.append, clear_globs=False).failed
        names.update(test.globs)
        assert not failed, "".join(said)
    else:
        lines = "\n" * (block.line - 1) + block.code  # so that a traceback names the page's line
        exec(compile(lines, str(block.page), "exec"), names)  # noqa: S102  our own pages


def write_data(block: Block, folder: Path) -> None:
    if block.language == "toml":
        tomllib.loads(block.code)
    elif block.language == "json":
        json.loads(block.code)
    else:
        assert len({len(row) for row in csv.reader(block.code.splitlines())}) == 1, where(block)
    if block.file:
        path = folder / block.file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(block.code, encoding="utf-8")


@pytest.mark.parametrize("page", [p for p in pages() if blocks(p)], ids=title)
def test_the_code_of_a_page_runs(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(ROOT / "examples")  # a reader stands in the checkout
    monkeypatch.setenv("MPLBACKEND", "Agg")
    names: dict[str, object] = {"__name__": "page"}
    for block in blocks(page):
        if block.language == "python":
            run_python(block, names)
        elif block.language == "console":
            run_console(block, tmp_path)
        elif block.language in {"toml", "json", "csv"}:
            write_data(block, tmp_path)
        else:
            known = block.language == "text" or DIRECTIVES.fullmatch(block.language)
            assert known, f"{where(block)}: no such language of a block: {block.language!r}"


def test_a_wrong_block_is_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("Text.\n```console\n$ echo one; exit 3\ntwo\n```\n```python x.py\n1 / 0\n```\n")
    console, python = (block._replace(page=ROOT / "README.md") for block in blocks(page))
    assert (console.line, python.line, python.file) == (3, 7, "x.py")
    with pytest.raises(AssertionError, match="exit 3"):
        run_console(console, tmp_path)
    with pytest.raises(AssertionError, match="two"):
        run_console(console._replace(code="$ echo one\ntwo\n"), tmp_path)
    run_console(console._replace(code="$ false  # exit 1\n$ echo one two\none ...\n"), tmp_path)
    with pytest.raises(ZeroDivisionError):
        run_python(python, {})
    with pytest.raises(AssertionError, match="Expected"):
        run_python(python._replace(code=">>> 1 + 1\n3\n"), {})
    with pytest.raises(AssertionError, match="no such target"):
        run_console(console._replace(code="$ make nothing\n"), tmp_path)
    with pytest.raises(AssertionError, match="no such extra"):
        run_console(console._replace(code='$ pip install ".[nothing]"\n'), tmp_path)


LINK = re.compile(r"\[[^\]]*\]\(([^)#\s]+)(#[^)]*)?\)")


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md", "CHANGELOG.md"])
def test_links_of_a_page_outside_the_docs_lead_somewhere(page: str) -> None:
    targets = [target for target, _ in LINK.findall((ROOT / page).read_text(encoding="utf-8"))]
    missing = [t for t in targets if "://" not in t and not (ROOT / t).exists()]
    assert not missing


def test_generated_pages_are_what_the_program_says() -> None:
    check = [sys.executable, str(ROOT / "scripts" / "reference.py"), "--check"]
    run = subprocess.run(check, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr


def test_every_page_of_the_docs_can_be_reached() -> None:
    """Every page stands in a table of contents."""
    listed = {DOCS / "index.md"}
    for page in pages()[1:]:
        for block in blocks(page):
            if block.language == "{toctree}":
                names = [line for line in block.code.splitlines() if line and line[0] != ":"]
                listed |= {(page.parent / f"{name.removesuffix('.md')}.md") for name in names}
    assert set(pages()[1:]) == listed
