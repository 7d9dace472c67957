"""The rooms do not go round the layers by the package's own names."""

from __future__ import annotations

import ast

from pages import ROOT

PACKAGE = ROOT / "src" / "trackfield"


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
