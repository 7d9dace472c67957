"""Golden cases of trajectories from energy profiles, Berger: a function a kind."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

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
    "energy_message": energy_message,
    "energy_local_ml": energy_local_ml,
    "energy_local_fim": energy_local_fim,
    "energy_rayleigh_nll": energy_rayleigh_nll,
}
