"""How Sphinx builds these pages: Markdown, the furo theme, docstrings as the house writes them."""

from __future__ import annotations

import re

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


def setup(app: Sphinx) -> None:
    """Tell Sphinx of the two rules above, and that CSV is plain text."""
    app.add_lexer("csv", TextLexer)
    app.connect("autodoc-process-docstring", _docstring)
    app.connect("autodoc-skip-member", _skip)
