"""How Sphinx builds these pages: Markdown, the furo theme, docstrings as the house writes them."""

from __future__ import annotations

import importlib
import pkgutil
import re
from collections.abc import Iterator
from typing import ForwardRef, TypeVar

from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx

import trackfield

project = "trackfield"
author = "The trackfield authors"
copyright = author
version = release = trackfield.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc"]
myst_enable_extensions = ["dollarmath", "deflist", "colon_fence"]
myst_heading_anchors = 3
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"trackfield {version}"
html_extra_path = ["reference/site.schema.json", "reference/scenario.schema.json"]
templates_path: list[str] = []

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_type_aliases = {name: name for name in ("Vector", "Matrix", "Indices")}
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
toc_object_entries = False


def _plain(line: str) -> str:
    """Keep `code` as code, and everything else as the words it is: |x|, 2 * x and x_ too."""
    parts = re.split(r"(`+[^`]*`+)", line)
    for i, part in enumerate(parts):
        if i % 2:
            parts[i] = f"``{part.strip('`')}``"
        else:
            parts[i] = re.sub(r"([\\*|]|_\b)", r"\\\1", part)
    return "".join(parts)


def _docstring(
    _app: Sphinx, _what: str, _name: str, _obj: object, _options: object, lines: list[str]
) -> None:
    lines[:] = [_plain(line) for line in lines]


def _skip(
    _app: Sphinx, _what: str, _name: str, obj: object, _skip: bool, _options: object
) -> bool | None:
    """Leave out the fields of a NamedTuple, which stand in its signature."""
    return True if type(obj).__name__ == "_tuplegetter" else None


def _named_tuples() -> Iterator[type]:
    for module in pkgutil.walk_packages(trackfield.__path__, "trackfield."):
        if not module.name.endswith("__main__"):
            for found in vars(importlib.import_module(module.name)).values():
                if isinstance(found, type) and hasattr(found, "_fields"):
                    yield found


def _qualify(_app: Sphinx) -> None:
    """Write the types of NamedTuples' fields in full: Sphinx cannot tell whose `Info` is meant."""
    for found in _named_tuples():
        names = vars(importlib.import_module(found.__module__))

        def full(word: re.Match[str], names: dict[str, object] = names) -> str:
            kind = names.get(word[0])
            named = isinstance(kind, type | TypeVar) and kind.__module__.startswith("trackfield.")
            return f"{kind.__module__}.{kind.__name__}" if named else word[0]

        for field, kind in found.__new__.__annotations__.items():
            if isinstance(kind, ForwardRef):
                written = re.sub(r"(?<![\w.])[A-Z]\w*", full, kind.__forward_arg__)
                found.__new__.__annotations__[field] = ForwardRef(written)


def setup(app: Sphinx) -> None:
    """Tell Sphinx of the rules above, and that CSV is plain text."""
    app.add_lexer("csv", TextLexer)
    app.connect("builder-inited", _qualify)
    app.connect("autodoc-process-docstring", _docstring)
    app.connect("autodoc-skip-member", _skip)
