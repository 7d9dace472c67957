"""Evaluate golden cases with the package's public functions: `python -m tests.golden FILE.json`.

One line a case; exit 1 if a case fails or its kind is unknown.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from trackfield.filtering import converted, extended, kalman
from trackfield.localization import bounds, range_mle, trilateration
from trackfield.localization.range_likelihood import RangeScan
from trackfield.motion import SteppedAcceleration
from trackfield.sensing import range_statistics
from trackfield.sensing.range import RangeModel
from trackfield.types import Gaussian, Matrix, Vector

if __package__:  # run as `python -m tests.golden`
    from tests import golden_berger, golden_cheng, golden_oh, golden_pham
else:
    import golden_berger
    import golden_cheng
    import golden_oh
    import golden_pham

Case = dict[str, Any]
Answer = dict[str, Any]


class Verdict(NamedTuple):
    """What became of a case: its `line` is printed."""

    known: bool
    passed: bool
    line: str


def range_calibration_ls(given: Case) -> Answer:
    tests = range_statistics.RangeTests(
        np.array(given["r"]), np.array(given["zbar"]), np.array(given["s2"])
    )
    found = range_statistics.noise_statistics(tests, method="least squares")
    return {
        "mu_n": found.bias_m,
        "mu_g": found.scale,
        "var_n": found.variance_m2,
        "var_g": found.variance_scale,
    }


def range_cost_gradient_hessian(given: Case) -> Answer:
    found = range_mle.cost_gradient_hessian(_scan(given), np.array(given["p"], float))
    return {"f": found.cost, "grad": found.gradient, "hess": found.hessian}


def range_mle_paper(given: Case) -> Answer:
    scan, start = _scan(given), np.array(given["p0"], float)
    found = range_mle.newton(scan, start)
    if not found.determined:  # raw Newton went astray; the damped search leads it
        found = range_mle.newton(scan, range_mle.mle(scan, start).position)
    return {"p": found.position, "R": found.covariance}


def range_fisher(given: Case) -> Answer:
    where = np.array(given["sensors"], float), np.array(given["p"], float)
    J = bounds.range_information(*where, models=_model(given))
    bound = bounds.range_bound(*where, models=_model(given))
    return {"J": J, "trace_crlb": np.trace(bound.covariance)}


def range_ekf_update(given: Case) -> Answer:
    model, z = _model(given), np.array(given["z"], float)
    order = _positions_first(len(given["x"]))
    prior = Gaussian(_vector(given["x"])[order], _matrix(given["P"], len(order))[order][:, order])
    sensor = extended.Ranges(np.array(given["sensors"], float), model)
    variance = model.sigma_m**2 + model.sigma_scale**2 * z**2
    posterior = extended.update(prior, z, sensor, variance=variance).posterior
    return _wang_order(posterior, order)


def converted_measurement_kf(given: Case) -> Answer:
    order = _positions_first(len(given["x"]))
    belief = Gaussian(_vector(given["x"])[order], _matrix(given["P"], len(order))[order][:, order])
    motion = SteppedAcceleration(tuple(given["Qw"]))
    dt_s = given["dt"]
    prior = kalman.predict(belief, motion.transition(dt_s), motion.noise(dt_s))
    z = _vector(given["zbar"])
    report = converted.Prelocalized(z, _matrix(given["R"], len(z)), np.ones((), bool))
    posterior = converted.update(prior, report).posterior
    predicted = _wang_order(prior, order)
    return {
        "x_pred": predicted["x"],
        "P_pred": predicted["P"],
        **_wang_order(posterior, order),
    }


def trilateration_ols(given: Case) -> Answer:
    c, d = np.array(given["c"], float), np.array(given["d"], float)
    pairs = trilateration.pair_system(c, d)
    return {"A": pairs.matrix, "r": pairs.right, "T": trilateration.ordinary(c, d).position}


def trilateration_covariance(given: Case) -> Answer:
    c, position = np.array(given["c"], float), np.array(given["T"], float)
    theta = trilateration.ordinary_covariance(c, position, sigma_m=given["sigma"])
    return {
        "Phi": trilateration.pair_covariance(c, position, sigma_m=given["sigma"]),
        "Theta": theta,
        "trace": np.trace(theta),
    }


def trilateration_traces(given: Case) -> Answer:
    found = trilateration.traces(np.array(given["c"], float), np.array(given["T"], float))
    return {"ols": found.ordinary, "blue": found.blue, "crlb": found.crlb}


KINDS: dict[str, Callable[[Case], Answer]] = {
    "range_calibration_ls": range_calibration_ls,
    "range_cost_gradient_hessian": range_cost_gradient_hessian,
    "range_mle": range_mle_paper,
    "range_fisher": range_fisher,
    "range_ekf_update": range_ekf_update,
    "converted_measurement_kf": converted_measurement_kf,
    "trilateration_ols": trilateration_ols,
    "trilateration_covariance": trilateration_covariance,
    "trilateration_traces": trilateration_traces,
    **golden_berger.KINDS,
    **golden_cheng.KINDS,
    **golden_oh.KINDS,
    **golden_pham.KINDS,
}


def load(path: Path) -> list[Case]:
    return json.loads(path.read_text())["cases"]


def evaluate(case: Case) -> Verdict:
    name, kind = case.get("id", "?"), case.get("kind", "?")
    if kind not in KINDS:
        return Verdict(known=False, passed=False, line=f"UNKNOWN {name}: kind {kind}")
    try:
        answer = KINDS[kind](case["input"])
    except Exception as error:  # noqa: BLE001 (a case that raises has failed; the others go on)
        line = f"FAIL    {name}: {kind}: {type(error).__name__}: {error}"
        return Verdict(known=True, passed=False, line=line)
    rtol = case.get("rtol", 1e-9)
    for field, expected in case["expected"].items():
        if isinstance(expected, str):  # a note
            continue
        limit = rtol.get(field, 1e-9) if isinstance(rtol, dict) else rtol
        fault = _fault(answer.get(field), expected, limit)
        if fault:
            line = f"FAIL    {name}: {kind}: {field}: {fault}"
            return Verdict(known=True, passed=False, line=line)
    return Verdict(known=True, passed=True, line=f"ok      {name}: {kind}")


def main(arguments: list[str]) -> int:
    if len(arguments) != 1:
        sys.stderr.write("usage: python -m tests.golden FILE.json\n")
        return 2
    verdicts = [evaluate(case) for case in load(Path(arguments[0]))]
    for verdict in verdicts:
        sys.stdout.write(verdict.line + "\n")
    return 0 if all(verdict.passed for verdict in verdicts) else 1


def _fault(found: object, expected: object, rtol: float) -> str:
    """What is wrong, or nothing; zeros may differ by rounding against the field's largest entry."""
    if found is None:
        return "not computed"
    if isinstance(found, tuple):  # one of these
        faults = [_fault(one, expected, rtol) for one in found]
        return "" if "" in faults else "; ".join(faults)
    a, b = np.asarray(found, float), np.asarray(expected, float)
    if a.shape != b.shape:
        return f"shape {a.shape}, expected {b.shape}"
    if np.allclose(a, b, rtol=rtol, atol=1e-3 * rtol * float(np.abs(b).max(initial=0.0))):
        return ""
    return f"found {a.tolist()}, expected {b.tolist()}"


def _model(given: Case) -> RangeModel:
    return RangeModel(
        bias_m=given.get("mu_n", 0.0),
        scale=given.get("mu_g", 0.0),
        sigma_m=math.sqrt(given["var_n"]),
        sigma_scale=math.sqrt(given["var_g"]),
    )


def _scan(given: Case) -> RangeScan:
    return RangeScan(np.array(given["sensors"], float), np.array(given["z"], float), _model(given))


def _vector(given: list[float]) -> Vector:
    return np.array(given, float)


def _matrix(given: str | list[list[float]], size: int) -> Matrix:
    """Read a matrix given by its rows or as "0.01*I4"."""
    if isinstance(given, str):
        factor, _, _ = given.partition("*")
        return float(factor) * np.eye(size)
    return np.array(given, float)


def _positions_first(size: int) -> list[int]:
    """Places of [x, y, .., vx, vy, ..] in Wang's [x, vx, y, vy, ..]."""
    return [*range(0, size, 2), *range(1, size, 2)]


def _wang_order(belief: Gaussian, order: list[int]) -> Answer:
    back = np.argsort(order)
    return {"x": belief.mean[back], "P": belief.covariance[back][:, back]}


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
