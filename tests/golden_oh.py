"""Golden cases of many unknown targets over a lossy network, Oh: a function a kind."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from trackfield.association.partition import Life, Window, log_ratio
from trackfield.localization import centroid
from trackfield.localization.detection_cells import cell_likelihood
from trackfield.metrics import ospa
from trackfield.network import channel
from trackfield.pursuit import assignment, robust, steering

Case = dict[str, Any]
Answer = dict[str, Any]


def p_cs(given: Case) -> Answer:
    network = channel.Channel(p_loss=given["p_te"])
    return {"p_cs": channel.delivery_probability(network, given["k"])}


def delay_pmf(given: Case) -> Answer:
    return {"p": channel.delay_probability(given["p_de"], given["k"], given["d"])}


def cell_likelihood_(given: Case) -> Answer:
    detected, inside = (np.array(given[name], bool) for name in ("z", "cell_inside"))
    found = cell_likelihood(detected, inside, p=np.array(given["p"]), q=np.array(given["q"]))
    return {
        "P": np.exp(found.total),
        "det_part": np.exp(found.detection),
        "false_part": np.exp(found.false_detection),
    }


def gospa(given: Case) -> Answer:
    one, other = (np.array(given[name], float).reshape(-1, 2) for name in ("X", "Y"))
    scale = {"cutoff_m": given["c"], "order": given["p"]}
    return {
        "gospa": ospa.gospa(one, other, **scale, alpha=given["alpha"]).gospa_m,
        "ospa": ospa.ospa(one, other, **scale),
    }


def leader_centroid(given: Case) -> Answer:
    election = centroid.Election(given["theta"], given["R_s"])
    sensors, z = (np.array(given[name], float) for name in ("sensors", "z"))
    found = centroid.locate(sensors, z, election=election)
    return {"leaders": found.leader, "estimates": found.position}


def log_posterior_ratio(given: Case) -> Answer:
    model, slot = given["model"], np.array(given["t"], np.int32)
    slots, n = given["T"], slot.size
    window = Window(
        t_s=model["delta"] * np.arange(slots, dtype=float),
        survival=np.full(slots, 1.0 - model["p_z"]),
        slot=slot,
        position=np.array(given["z"], float),
        covariance=np.tile([model["R"], 0.0, model["R"]], (n, 1)),
        log_birth=np.full(n, math.log(model["lambda_b"])),
        log_false=np.full(n, math.log(model["lambda_f"])),
        p_detection=np.full((slots, n), model["p_d"]),
        life=Life(
            math.sqrt(model["q_accel"]),
            model["sigma_v0"],
            model["delta"],
            log_death=math.log(model["p_z"]),
        ),
    )
    return {"log_ratio_to_all_false": [log_ratio(window, w) for w in given["partitions"]]}


def min_time_axis(given: Case) -> Answer:
    state, limit = (given["xi"], given["xidot"]), given["U_p"]
    return {
        "u": steering.thrust(*state, limit_m_s2=limit),
        "T_c": steering.time_to_rest(*state, limit_m_s2=limit),
    }


def time_to_capture(given: Case) -> Answer:
    offset, velocity = np.split(np.array(given["xi"], float), 2)
    return {"T_c": steering.time_to_capture(offset, velocity, limit_m_s2=given["U_p"])}


def robust_minmax(given: Case) -> Answer:
    found = robust.robust_thrust(
        given["eta"],
        given["etadot"],
        limit_m_s2=given["U_p"],
        doubt=robust.Doubt(given["V"], given["Vdot"], given["U_e"]),
        step_s=given["delta"],
    )
    return {"u": found.thrust_m_s2, "worst_T": found.worst_s}


def bottleneck(given: Case) -> Answer:
    costs = np.array(given["C"], float)
    return {
        "value": assignment.bottleneck(costs),
        "greedy_value": assignment.assign(costs, "greedy").last_s,
    }


KINDS: dict[str, Callable[[Case], Answer]] = {
    "p_cs": p_cs,
    "delay_pmf": delay_pmf,
    "cell_likelihood": cell_likelihood_,
    "gospa": gospa,
    "leader_centroid": leader_centroid,
    "log_posterior_ratio": log_posterior_ratio,
    "min_time_axis": min_time_axis,
    "time_to_capture": time_to_capture,
    "robust_minmax": robust_minmax,
    "bottleneck": bottleneck,
}
