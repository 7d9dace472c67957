"""Golden cases of Pham's dissertation: geometry, selection, energy, lifetime and the robot."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from trackfield.localization.information import reading_gains
from trackfield.network.energy import Energy, network_power
from trackfield.network.node_index import NodeIndex
from trackfield.robot import car as robot_car
from trackfield.robot import rule as robot
from trackfield.scheduling import master, paper_selection, uncertainty
from trackfield.scheduling.activation import Zone, activate
from trackfield.scheduling.cost import energy_cost, exponential, inverse, linear
from trackfield.scheduling.lifetime_search import rank_order
from trackfield.scheduling.selection import select
from trackfield.sensing.range import RangeModel

Case = dict[str, Any]
Answer = dict[str, Any]


def network_energy(given: Case) -> Answer:
    energy = Energy(**{f"{name}_mw": float(given[name]) for name in ("tx", "rx", "idle", "sleep")})
    counts = {"measuring": given["na"], "warned": given["ni"], "watching": given["nb"]}
    return {"total": network_power(energy, given["n"], **counts)}


def activation_region(given: Case) -> Answer:
    ticks = 0.5 * np.arange(21)  # the grid of all cases: x = 0, .5 .. 10; y same
    nodes = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    zone = Zone(given["R1"], given["R2"], np.radians(given["alpha_deg"]))
    where = np.array([given["O"]], float), np.array([given["heading"]], float)
    found = activate(NodeIndex(nodes), where[0], headings=where[1], zone=zone)
    return {"count": len(found.node)}


def power_cost(given: Case) -> Answer:
    prices = {"inv": inverse(), "lin": linear(2.0), "exp": exponential()}
    x = np.array([given["x"]])
    return {name: energy_cost(x, given["s"], price=p)[0] for name, p in prices.items()}


def rank_sum_selection(given: Case) -> Answer:
    costs, sets = np.array(given["cost"]), np.array(given["feasible_triples"], np.int32)
    sums = costs[sets].sum(axis=1)
    paper, best = int(rank_order(costs, sets)[0]), int(np.argmin(sums))
    return {
        "rank_sum": sets[paper],
        "rank_sum_cost": sums[paper],
        "optimum": sets[best],
        "optimum_cost": sums[best],
    }


def master_choice(given: Case) -> Answer:
    cost = master.costs(given["D"], given["Pres"], alpha=given["alpha"])
    return {"W": cost, "chosen": master.choose(cost, given["current"]).node}


def select_2d(given: Case) -> Answer:
    sensors, position = np.array(given["sensors"], float), np.array(given["T"], float)
    best = select(reading_gains(RangeModel(sigma_m=1.0), sensors, position), 3)
    return {
        "exhaustive": best.sensors,
        "corrected_function2d": paper_selection.function_2d(sensors, position),
        "greedy": paper_selection.best_pair_and_next(sensors, position, 3),
        "paper_literal": paper_selection.function_2d(sensors, position, printed=True),
        "trace_exhaustive": best.value,
    }


def select_3d(given: Case) -> Answer:
    sensors, position = np.array(given["sensors"], float), np.array(given["T"], float)
    return {
        "function3d": paper_selection.function_3d(sensors, position),
        "exhaustive": select(reading_gains(RangeModel(sigma_m=1.0), sensors, position), 4).sensors,
    }


def two_sensor_covariance(given: Case) -> Answer:
    sigma_m = given["sigma"]
    theta = uncertainty.two_sensor_covariance(given["phi"], given["alpha"], sigma_m=sigma_m)
    return {"Theta": theta}


def two_sensor_uncertainty(given: Case) -> Answer:
    angle = np.radians(given["alpha_deg"])
    return {
        "half_chord": uncertainty.half_chord(given["RS"], given["d"]),
        "diag": uncertainty.long_diagonal(given["u"], angle),
    }


def three_sensor_trace_2d(given: Case) -> Answer:
    best = uncertainty.best_third(given["alpha"])
    return {
        "trace": uncertainty.three_sensor_trace(given["alpha"], given["beta"]),
        "best_beta": best.beta,
        "best_trace": best.trace,
    }


def three_sensor_trace_3d(given: Case) -> Answer:
    angles = given["alpha"], given["beta"]
    return {"trace": uncertainty.three_sensor_trace_3d(*angles, gamma=given["gamma"])}


def two_circle_condition(given: Case) -> Answer:
    near, far, apart = np.array(given["cases"], float).T
    ok = uncertainty.two_cells(near, far, apart_m=apart, error_m=given["u"])
    return {"ok": ok.astype(int)}


def robot_step(given: Case) -> Answer:
    link = robot.Link(given["tau_c"], given["tau_s"], given["dtau"])
    start, target = np.array(given["M"], float), np.array(given["T"], float)
    return {"M_next": robot.least_move(start, target, reach_m=link.reach_m)}


def car_motion(given: Case) -> Answer:
    car = robot_car.Car(max_speed_m_s=1.0, wheel_base_m=given["L"])
    controls = {"speed_m_s": given["v"], "steering_rad": given["phi"], "t_s": given["t"]}
    return {"q": robot_car.moved(given["q0"], car, **controls)}


KINDS: dict[str, Callable[[Case], Answer]] = {
    "select_2d": select_2d,
    "select_3d": select_3d,
    "activation_region": activation_region,
    "network_energy": network_energy,
    "power_cost": power_cost,
    "rank_sum_selection": rank_sum_selection,
    "master_choice": master_choice,
    "three_sensor_trace_2d": three_sensor_trace_2d,
    "three_sensor_trace_3d": three_sensor_trace_3d,
    "two_circle_condition": two_circle_condition,
    "two_sensor_covariance": two_sensor_covariance,
    "two_sensor_uncertainty": two_sensor_uncertainty,
    "robot_step": robot_step,
    "car_motion": car_motion,
}
