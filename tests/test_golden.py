"""Golden cases: all of the kinds we have are met; the evaluator fails where it should."""

import copy
import json
import subprocess
import sys

import pytest

from conftest import ROOT
from golden import KINDS, evaluate, load

FOLDER = ROOT / "tests" / "golden_data"
CASES = [case for path in sorted(FOLDER.glob("*.json")) for case in load(path)]
OURS = [case for case in CASES if case["kind"] in KINDS]
TO_COME = {  # kinds of rooms that do not stand yet
    "berger_cheng.json": set(),
    "oh.json": set(),
    "wang_pham.json": set(),
}


@pytest.mark.parametrize("case", OURS, ids=[case["id"] for case in OURS])
def test_case(case):
    verdict = evaluate(case)
    assert verdict.passed, verdict.line


def test_every_kind_that_we_answer_has_a_case():
    assert {case["kind"] for case in OURS} == set(KINDS)


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.json")), ids=lambda path: path.name)
def test_all_other_kinds_are_of_rooms_to_come(path):
    assert {case["kind"] for case in load(path)} - set(KINDS) == TO_COME[path.name]


def test_the_copies_are_the_shared_files(shared):
    for path in FOLDER.glob("*.json"):
        assert load(path) == load(shared / "golden" / path.name)


@pytest.mark.parametrize("case", OURS, ids=[case["id"] for case in OURS])
def test_a_wrong_expectation_fails_in_every_field(case):
    for field, value in case["expected"].items():
        if isinstance(value, str):  # a note
            continue
        wrong = copy.deepcopy(case)
        wrong["expected"][field] = _nudged(wrong["expected"][field], _limit(case, field))
        verdict = evaluate(wrong)
        assert not verdict.passed
        assert field in verdict.line


def test_a_tolerance_may_be_given_by_field():
    case = copy.deepcopy(next(c for c in OURS if c["kind"] == "range_calibration_ls"))
    case["expected"]["mu_g"] *= 1.001
    case["rtol"] = {"mu_g": 1e-2}
    assert evaluate(case).passed
    case["rtol"] = {"mu_n": 1e-2}
    assert not evaluate(case).passed


@pytest.mark.parametrize(
    ("kinds", "code", "word"),
    [(["range_fisher"], 0, "ok"), (["range_fisher", "not_a_kind"], 1, "UNKNOWN")],
)
def test_the_command_prints_a_line_a_case_and_fails_on_unknown_kinds(tmp_path, kinds, code, word):
    case = next(c for c in OURS if c["kind"] == "range_fisher")
    path = tmp_path / "cases.json"
    path.write_text(json.dumps({"cases": [{**case, "kind": kind} for kind in kinds]}))
    done = subprocess.run(
        [sys.executable, "-m", "tests.golden", str(path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == code, done.stderr
    lines = done.stdout.splitlines()
    assert len(lines) == len(kinds)
    assert lines[-1].startswith(word)


def _limit(case, field):
    rtol = case.get("rtol", 1e-9)
    return rtol.get(field, 1e-9) if isinstance(rtol, dict) else rtol


def _nudged(value, limit):
    """Change a value by more than its tolerance."""
    if isinstance(value, list):
        return [_nudged(value[0], limit), *value[1:]]
    return value * (1.0001 + 2.0 * limit) + 1e-6
