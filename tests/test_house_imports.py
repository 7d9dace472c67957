"""What an import costs, and that the rooms do not go round by the package's own names."""

from __future__ import annotations

import ast
import subprocess
import sys

import pytest

from pages import ROOT

PACKAGE = ROOT / "src" / "trackfield"
HEAVY = {"matplotlib", "numpy", "pandas", "pyarrow", "pydantic", "rich", "scipy"}


def loaded_by(code: str) -> set[str]:
    """Packages that a fresh interpreter has loaded after running `code`."""
    ask = f"import sys\n{code}\nprint(*{{name.partition('.')[0] for name in sys.modules}})"
    run = subprocess.run([sys.executable, "-c", ask], capture_output=True, text=True, check=True)
    return set(run.stdout.splitlines()[-1].split())


def test_the_package_alone_loads_nothing_heavy() -> None:
    assert not loaded_by("import trackfield") & HEAVY
    assert "numpy" in loaded_by("import trackfield; trackfield.Readings")


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["track", "--help"]])
def test_help_loads_nothing_heavy(arguments: list[str]) -> None:
    code = f"from trackfield.cli import main; main({arguments})"
    allowed = {"pydantic"} if len(arguments) > 1 else set()  # typer loads it for a verb's options
    assert not loaded_by(code) & HEAVY - allowed


def test_every_public_name_loads_and_no_other() -> None:
    import trackfield

    assert all(getattr(trackfield, name) is not None for name in trackfield.__all__)
    assert set(trackfield.__all__) <= set(dir(trackfield))
    assert "no_such_name" not in dir(trackfield)
    with pytest.raises(AttributeError, match="no_such_name"):
        trackfield.no_such_name  # noqa: B018  asking for it is the test


def test_no_room_imports_the_package_s_own_names() -> None:
    """The layers are checked by module; `from trackfield import track` would slip through."""
    rooms = {path.stem for path in PACKAGE.iterdir()}
    found = []
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module == "trackfield":
                names = {alias.name for alias in node.names} - rooms - {"__version__"}
                found += [(path.name, name) for name in names]
    assert not found
