"""What is wrong with a scenario's pursuit beyond the types of its keys."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from trackfield.errors import ConfigurationError, InputError
from trackfield.pursuit import separation
from trackfield.pursuit.separation import Body, Fleet
from trackfield.robot.obstacles import Obstacles
from trackfield.simulation.game import starts, vehicle_of
from trackfield.simulation.scenario import Pursuit, Scenario

_MOST = 200  # pursuers
_SEEN = {"signal", "detection"}  # kinds by which targets without a name are seen in time
_KEYS = {  # that concern some vehicles only
    "thrust_m_s2": {"thruster"},
    "error_m_s2": {"thruster"},
    "apart_m": {"thruster"},
    "clear_m": {"thruster"},
    "steering_deg": {"car"},
    "wheel_base_m": {"car"},
}


def pursuit_problems(scenario: Scenario) -> Iterator[str]:
    """Say which keys of a pursuit, each sound by itself, do not go together."""
    rules = scenario.pursuit
    for i, party in enumerate(scenario.targets, start=1):
        if party.evade_m_s2 > 0.0 and party.border != "bounce":
            yield (
                f"targets[{i}].evade_m_s2: found with border {party.border!r}, expected 'bounce': "
                "who flees stays in the region"
            )
        if party.evade_m_s2 > 0.0 and rules is None:
            yield f"targets[{i}].evade_m_s2: found without [pursuit]"
    if rules is None:
        for name in ("pursuers", "obstacles"):
            if getattr(scenario, name):
                yield f"{name}: found without [pursuit], expected who chases the targets"
        return
    for kind in sorted({*scenario.models} - _SEEN):
        yield f"pursuit: found with [{kind}], expected [signal], [detection] or [reports]"
    if scenario.scheduling is not None:
        yield "pursuit: found with [scheduling], expected sensors that measure all the time"
    if not 0 < len(scenario.pursuers) <= _MOST:
        yield f"pursuers: found {len(scenario.pursuers)}, expected from 1 to {_MOST} [[pursuers]]"
    for key, kinds in _KEYS.items():
        usual = Pursuit.__dataclass_fields__[key].default
        if rules.vehicle not in kinds and getattr(rules, key) != usual:
            (kind,) = kinds
            yield f"pursuit.{key}: found with vehicle {rules.vehicle!r}; it is for {kind!r}"
    yield from _places(scenario, rules)


def _places(scenario: Scenario, rules: Pursuit) -> Iterator[str]:
    """Say which obstacles are none, and which pursuers cannot start where they are put."""
    sound: list[tuple[tuple[float, float], ...]] = []
    for i, shape in enumerate(scenario.obstacles, start=1):
        try:
            Obstacles([shape.corners])
            sound.append(shape.corners)
        except InputError as problem:
            yield f"obstacles[{i}].corners: {problem}"
    try:
        vehicle = vehicle_of(rules)
    except ConfigurationError as error:
        yield from (f"pursuit.{problem.removeprefix('body.')}" for problem in error.problems)
        return
    states, real = starts(scenario), Obstacles(sound)
    if not isinstance(vehicle, Body):
        for i in np.flatnonzero(~real.free(states[:, :2])):
            yield f"pursuers[{i + 1}].at: found {list(scenario.pursuers[i].at)}, in an obstacle"
        return
    clearance = real.distance if real.parts else None
    fleet = Fleet(states[:, :2], states[:, 2:])
    try:
        separation.check_start(fleet, vehicle, step_s=scenario.step_s, clearance=clearance)
    except InputError as problem:
        yield f"pursuers: {problem} (counted from 0)"
