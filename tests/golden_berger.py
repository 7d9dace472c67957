"""Golden cases of trajectories from energy profiles, Berger: a function a kind."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from trackfield.localization import pass_bounds, pass_lifted, pass_pairs
from trackfield.localization.pass_fusion import fuse
from trackfield.localization.pass_messages import PassMessages, common_records, fishers
from trackfield.sensing import profile as profiles
from trackfield.sensing.amplitude import AmplitudeModel
from trackfield.sensing.amplitude_likelihood import misfit
from trackfield.sensing.pass_profile import predict
from trackfield.types import Vector

Case = dict[str, Any]
Answer = dict[str, Any]


def energy_message(given: Case) -> Answer:
    theta = np.array([given["P"], *given["x0"], *given["v"]], float)
    found = predict(theta, np.array([given["sensor"]], float), exponent=given["alpha"])
    return dict(zip(("a_max", "t_max", "dt"), found.array()[0], strict=True))


def energy_local_ml(given: Case) -> Answer:
    psi, t_s = profiles.Profile(*given["psi"]), np.array(given["t"], float)
    return {
        "a": profiles.expected(psi, t_s, exponent=given["alpha"]),
        "grad": profiles.gradient(psi, t_s, exponent=given["alpha"]),
    }


def energy_local_fim(given: Case) -> Answer:
    J = profiles.information(profiles.Profile(*given["psi"]), times(given["t"]), model(given))
    return {"J": J, "crlb_sd": np.sqrt(np.diag(np.linalg.inv(J)))}


def energy_rayleigh_nll(given: Case) -> Answer:
    told = AmplitudeModel(sigma=math.sqrt(given["N0"]), fading="rayleigh")
    cost = misfit(told, np.array(given["r"], float), mean=np.array(given["a"], float)).cost
    return {"nll": cost.sum()}


def energy_pair_solutions(given: Case) -> Answer:
    first, second = (profiles.Profile(*given[name]) for name in ("psi1", "psi2"))
    sensors = np.array([given["s1"], given["s2"]], float)
    found = pass_pairs.pair_passes(first, second, sensors, exponent=given["alpha"])
    return {"solutions": found.theta, "truth": tuple(found.theta)}


def energy_lifted_solution(given: Case) -> Answer:
    """Take the linear solution, none if the search of the fusion center ends elsewhere."""
    sensors, n = np.array(given["sensors"], float), len(given["sensors"])
    messages = PassMessages(
        sensors,
        (model(given),) * n,
        np.array(given["messages"], float),
        common_records(n, times(given["t"])),
    )
    total = pass_lifted.empty(sensors.mean(axis=0), time_s=12.0)
    for psi, fisher, sensor in zip(messages.profiles, fishers(messages), sensors, strict=True):
        message = profiles.Profile(*psi)
        total = total.added(message, fisher, sensor, exponent=given["alpha"])
    theta = total.solved(exponent=given["alpha"]).theta
    agree = np.allclose(fuse(messages).theta[0], theta, rtol=1e-7)
    return {"theta": theta if agree else np.full(5, np.nan)}


def energy_crlb(given: Case) -> Answer:
    found = pass_bounds.pass_bound(
        np.array(given["theta"], float),
        np.array(given["sensors"], float),
        times(given["t"]),
        models=model(given),
        unknown_exponent=given["unknown_alpha"],
    )
    return {"sd": np.sqrt(np.diag(found.covariance))}


def model(given: Case) -> AmplitudeModel:
    fading = "rayleigh" if given.get("model") == "rayleigh" else "none"
    return AmplitudeModel(given["alpha"], sigma=math.sqrt(given["noise_var"]), fading=fading)


def times(given: str | list[float]) -> Vector:
    """Read times given one by one or as "0..24 step 1"."""
    if isinstance(given, str):
        span, _, step = given.partition(" step ")
        first, last = (float(end) for end in span.split(".."))
        return np.arange(first, last + 0.5 * float(step), float(step))
    return np.array(given, float)


KINDS: dict[str, Callable[[Case], Answer]] = {
    "energy_crlb": energy_crlb,
    "energy_lifted_solution": energy_lifted_solution,
    "energy_message": energy_message,
    "energy_local_ml": energy_local_ml,
    "energy_local_fim": energy_local_fim,
    "energy_pair_solutions": energy_pair_solutions,
    "energy_rayleigh_nll": energy_rayleigh_nll,
}
