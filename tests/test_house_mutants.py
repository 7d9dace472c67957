"""What breaks the sampler on purpose still fits its source, and the page tells what notices it.

The tests themselves do not run on the mutants: `scripts/mutants.py` does, in a quarter of an hour.
"""

import importlib.util
import re

import pytest

import test_association_mcmcda_chain as chain
from pages import DOCS, ROOT

SCRIPT = ROOT / "scripts" / "mutants.py"


@pytest.fixture(scope="module")
def mutants():
    spec = importlib.util.spec_from_file_location("mutants", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_mutant_changes_one_line_of_the_source(mutants):
    sound = mutants.sources(None)
    for mutant in mutants.MUTANTS:
        broken = mutants.sources(mutant)
        assert [name for name in sound if sound[name] != broken[name]] == [
            f"mcmcda_{mutant.file}.hpp"
        ], mutant.name


def test_the_page_tells_which_test_notices_each_mutant(mutants):
    text = (DOCS / "concepts" / "association_mcmcda.md").read_text(encoding="utf-8")
    noticed = re.findall(r"^\| ([^|]+) \| `([^|`]+)` \|$", text, re.MULTILINE)
    assert [name for name, _ in noticed] == [mutant.name for mutant in mutants.MUTANTS]
    assert {test.split("[")[0] for _, test in noticed} <= set(vars(chain))
