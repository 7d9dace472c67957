"""What a release says of itself agrees, wherever it is said."""

from __future__ import annotations

import re
import tomllib

import trackfield
from pages import ROOT

PROJECT = (ROOT / "pyproject.toml").read_text(encoding="utf-8")


def changelog_version() -> str:
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    found = re.search(r"^## (\d\S*)", text, re.MULTILINE)
    assert found
    return found[1]


def test_the_top_version_of_the_changelog_is_the_package_s() -> None:
    assert changelog_version() == trackfield.__version__


def test_the_citation_names_this_version_and_licence() -> None:
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    said = dict(re.findall(r"^(\w+): (.*)$", text, re.MULTILINE))
    assert said["version"] == trackfield.__version__
    assert said["license"] == tomllib.loads(PROJECT)["project"]["license"]


def test_every_exception_from_the_lint_rules_gives_its_reason() -> None:
    ruff = tomllib.loads(PROJECT)["tool"]["ruff"]["lint"]
    ignored = [
        *ruff["ignore"],
        *(rule for rules in ruff["per-file-ignores"].values() for rule in rules),
    ]
    for rule in ignored:
        assert re.search(rf'"{rule}",?\]? +# \w', PROJECT), rule
