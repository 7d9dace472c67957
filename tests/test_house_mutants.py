"""What breaks the sampler on purpose still fits its source, and the page tells what notices it.

The tests themselves do not run on the mutants: `scripts/mutants.py` does, in some minutes.
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


def test_every_mutant_changes_statements_of_the_source(mutants):
    broken = "".join(mutants.breakable().values())  # an error if a line is not there any more
    for number in range(len(mutants.MUTANTS)):
        assert broken.count(f"broken == {number})") + broken.count(f"broken == {number} ?") == 1


def test_the_page_tells_which_test_notices_each_mutant(mutants):
    text = (DOCS / "concepts" / "association_mcmcda.md").read_text(encoding="utf-8")
    noticed = re.findall(r"^\| ([^|]+) \| `([^|`]+)` \|$", text, re.MULTILINE)
    assert [name for name, _ in noticed] == [mutant.name for mutant in mutants.MUTANTS]
    assert {test.split("[")[0] for _, test in noticed} <= {*vars(chain), "not run"}
