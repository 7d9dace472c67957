"""What is wrong with a scenario beyond the types of its keys."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import Any, cast

from trackfield.network.bounds import bound
from trackfield.network.channel import Channel
from trackfield.network.energy import Energy
from trackfield.network.kinds import KINDS
from trackfield.network.site import Group, SchedulingSettings
from trackfield.simulation.deployment import sensor_count, sensor_names
from trackfield.simulation.pursuit_checks import pursuit_problems
from trackfield.simulation.scenario import MIXED, Fault, Party, Scenario, Sensors

_PATH = tuple[str | int, ...]
_BORROWED = {  # sections whose classes say no bounds; those of a site's keys hold
    **{name: kind.parameters for name, kind in KINDS.items()},
    "network": Channel,
    "groups": Group,
    "scheduling": SchedulingSettings,
    "energy": Energy,
}
_OWN_BOUNDS = ("scheduling", "energy")  # sections whose keys may have other bounds than elsewhere
_LOOPED = ("signal", "detection", "range")  # kinds that a closed loop is made of
_SENSED = (*KINDS, "reports")
_MOTION_KEYS = {  # of a party, those that concern some motions only
    "accel_sigma_m_s2": {"random", "crossing", "row"},
    "inset_m": {"random", "walk"},
    "path": {"walk"},
    "go_s": {"walk", "crossing"},
    "stop_s": {"walk", "crossing"},
    "within_m": {"crossing"},
    "start": {"row"},
    "heading_deg": {"row"},
    "spacing_m": {"row"},
}
_LAYOUT_KEYS = {
    "spacing_m": {"grid", "hexagonal"},
    "count": {"random"},
    "positions": {"listed"},
}
_FAULT_KEYS = {"factor": {"burst"}, "jump_s": {"clock_jump"}, "value": {"stuck"}}
_MOST_SENSORS = 1_000_000
_MOST_TARGETS = 100_000
_MOST_STEPS = 10_000_000
_MOST_ROWS = 50_000_000  # of truth


def borrowed_faults(document: Mapping[str, Any]) -> Iterator[tuple[_PATH, str]]:
    """Find numbers out of bounds in sections whose classes belong to other rooms."""
    for section, cls in _BORROWED.items():
        value = document.get(section)
        tables = cast("list[Any]", value) if isinstance(value, list) else [value]
        for place, table in enumerate(tables):
            if isinstance(table, Mapping):
                path = (section, place) if isinstance(value, list) else (section,)
                yield from _table_faults(path, cast("Mapping[str, Any]", table), cls)


def _table_faults(path: _PATH, table: Mapping[str, Any], cls: type) -> Iterator[tuple[_PATH, str]]:
    section = str(path[0]) if path[0] in _OWN_BOUNDS else "models"
    usual = {field.name: field.default for field in fields(cls)}
    for key, value in table.items():
        if key not in usual or isinstance(value, bool) or not isinstance(value, int | float):
            continue
        limits = bound(section, key)
        off = value == math.inf == usual[key]
        if not (off or math.isfinite(value)) or (limits and not _within(value, limits.limits)):
            expected = limits.expected if limits else "a finite number"
            yield (*path, key), f"found {value}, expected {expected}"


def _within(value: float, limits: Mapping[str, float]) -> bool:
    return (
        limits.get("ge", -math.inf) <= value <= limits.get("le", math.inf)
        and value > limits.get("gt", -math.inf)
        and (value < limits["lt"] if "lt" in limits else True)
    )


def contradictions(scenario: Scenario) -> Iterator[str]:
    """Say which keys, each sound by itself, do not go together."""
    x_min, y_min, x_max, y_max = scenario.region
    if not (x_min < x_max and y_min < y_max):
        yield (
            f"region: found {list(scenario.region)}, of no area, "
            "expected [x_min, y_min, x_max, y_max] with min below max"
        )
        return
    if scenario.steps > _MOST_STEPS:
        yield f"step_s: found {scenario.steps} steps, expected at most {_MOST_STEPS}"
        return  # what follows may look at every step
    rows = scenario.steps * sum(
        party.count + party.births_per_s * min(scenario.duration_s, _longest(party))
        for party in scenario.targets
    )
    if rows > _MOST_ROWS:
        yield f"targets: found up to {rows:.3g} rows of truth, expected at most {_MOST_ROWS}"
    yield from _sensing(scenario)
    yield from _network(scenario)
    yield from _loop(scenario)
    yield from pursuit_problems(scenario)
    for i, party in enumerate(scenario.targets, start=1):
        for problem in _party(scenario, party):
            yield f"targets[{i}]{problem}"
    for i, fault in enumerate(scenario.faults, start=1):
        for problem in _fault(scenario, fault):
            yield f"faults[{i}].{problem}"


def _sensing(scenario: Scenario) -> Iterator[str]:
    kinds = [kind for kind in _SENSED if getattr(scenario, kind) is not None]
    if len(kinds) != 1 and not (kinds and set(kinds) <= set(MIXED)):
        found = " and ".join(f"[{kind}]" for kind in kinds) or "nothing that is sensed"
        expected = ", ".join(f"[{kind}]" for kind in _SENSED)
        mixed = ", ".join(f"[{kind}]" for kind in MIXED)
        yield f"found {found}, expected one of {expected}, or several of {mixed}"
    yield from _records(scenario)
    detection = scenario.detection
    if detection is not None and detection.p_detection <= detection.p_false:
        yield (
            f"detection.p_detection: found {detection.p_detection:g}, "
            f"expected more than p_false = {detection.p_false:g}"
        )
    sensors = scenario.sensors
    if sensors is None:
        needs = [k for k in kinds if k != "reports"]
        needs += ["network"] if scenario.network is not None else []
        if needs:
            yield f"sensors: found nothing, expected [sensors] for [{needs[0]}]"
        return
    for problem in _idle(sensors, ("layout", sensors.layout), _LAYOUT_KEYS):
        yield f"sensors.{problem}"
    if sensors.threshold is not None and scenario.signal is None:
        yield f"sensors.threshold: found {sensors.threshold:g} without [signal]"
    count = sensor_count(scenario)
    if not 0 < count <= _MOST_SENSORS:
        expected = next(key for key, users in _LAYOUT_KEYS.items() if sensors.layout in users)
        yield (
            f"sensors.{expected}: found {count} sensors, expected from 1 to {_MOST_SENSORS} "
            f"with layout {sensors.layout!r}"
        )
    elif sensors.dead >= count:
        yield f"sensors.dead: found {sensors.dead} of {count} sensors, expected one that lives"


def _records(scenario: Scenario) -> Iterator[str]:
    """Say what records of energy messages cannot be made of the run's steps."""
    model = scenario.energy_message
    if model is None:
        return
    if abs(model.sample_s - scenario.step_s) > 1e-9 * scenario.step_s:
        yield (
            f"energy_message.sample_s: found {model.sample_s:g}, expected step_s = "
            f"{scenario.step_s:g}: sensors sample once a step"
        )
    if model.record_s > scenario.duration_s:
        yield (
            f"energy_message.record_s: found {model.record_s:g}, expected at most duration_s = "
            f"{scenario.duration_s:g}: a message is sent when its record ends"
        )


def _network(scenario: Scenario) -> Iterator[str]:
    for name, number in Counter(group.id for group in scenario.groups).items():
        if number > 1:
            yield f"groups: found {name!r} {number} times, expected every group once"
    for i, group in enumerate(scenario.groups, start=1):
        x_min, y_min, x_max, y_max = scenario.region
        if group.x_m < x_min or group.x_m > x_max or group.y_m < y_min or group.y_m > y_max:
            yield (
                f"groups[{i}]: found tier-2 node {group.id!r} at ({group.x_m:g}, {group.y_m:g}) m, "
                f"expected one in the region {list(scenario.region)}"
            )
    if scenario.carries is not None and scenario.network is None:
        yield f"carries: found {scenario.carries!r} without [network]"
    if scenario.fusion is not None and (scenario.signal is None or scenario.carries == "readings"):
        yield "fusion: found without [signal] whose reports travel, expected one that can be fused"
    if scenario.carries == "readings" and scenario.reports is not None:
        yield "carries: found 'readings', expected 'reports' with [reports]"


def _loop(scenario: Scenario) -> Iterator[str]:
    settings = scenario.scheduling
    if settings is None:
        if scenario.energy is not None:
            yield "energy: found without [scheduling], expected sensors that are told when to sense"
        return
    travel = scenario.network is not None and scenario.carried == "reports"
    if scenario.reports is not None or scenario.fusion is not None or travel:
        yield "scheduling: found with reports, expected readings of sensors, and no fusion of them"
    for kind in scenario.models:
        if kind not in _LOOPED:
            expected = ", ".join(f"[{one}]" for one in _LOOPED)
            yield f"scheduling: found with [{kind}], expected one of {expected}"
    if settings.interval_s < scenario.step_s * (1.0 - 1e-9):
        yield (
            f"scheduling.interval_s: found {settings.interval_s:g}, expected step_s = "
            f"{scenario.step_s:g} or more"
        )
    if settings.burst > 1 and scenario.range is None:
        yield f"scheduling.burst: found {settings.burst} without [range]"


def _party(scenario: Scenario, party: Party) -> Iterator[str]:
    yield from _spans(party)
    for problem in _idle(party, ("motion", party.motion), _MOTION_KEYS):
        yield f".{problem}"
    if party.lifetime_s is not None and party.mean_lifetime_s is not None:
        yield ": found both lifetime_s and mean_lifetime_s, expected one of them"
    loud = scenario.amplitude is not None or scenario.energy_message is not None
    if party.level != 1.0 and not loud:
        yield f".level: found {party.level:g} without [amplitude] or [energy_message]"
    if party.at_start > party.count:
        yield f".at_start: found {party.at_start} of count = {party.count} targets"
    if party.motion == "row" and party.births_per_s > 0.0:
        yield ".births_per_s: found with motion 'row', expected count"
    if party.enter_s[1] > scenario.duration_s:
        yield f".enter_s: found {list(party.enter_s)}, expected times within duration_s"
    if len(party.path) == 1:
        yield ".path: found one place, expected at least two"
    if party.count + party.births_per_s * scenario.duration_s > _MOST_TARGETS:
        yield f": found more than {_MOST_TARGETS} targets, expected fewer"
    x_min, y_min, x_max, y_max = scenario.region
    if 2.0 * party.inset_m >= min(x_max - x_min, y_max - y_min):
        yield f".inset_m: found {party.inset_m:g}, which leaves nothing of the region"


def _spans(party: Party) -> Iterator[str]:
    for span in ("enter_s", "lifetime_s", "speed_m_s", "go_s", "stop_s"):
        value = getattr(party, span)
        if value is not None and value[0] > value[1]:
            yield f".{span}: found {list(value)}, expected [low, high]"
    if party.go_s is not None and party.go_s[1] == 0.0:
        yield f".go_s: found {list(party.go_s)}, expected walkers that walk between stops"
    if party.motion in {"walk", "crossing"} and party.speed_m_s[0] == 0.0:
        yield f".speed_m_s: found {list(party.speed_m_s)}, expected speeds above 0"


def _longest(party: Party) -> float:
    """How long targets of a party stay, at most or on average, infinite if nothing is said [s]."""
    if party.lifetime_s is not None:
        return party.lifetime_s[1]
    return math.inf if party.mean_lifetime_s is None else party.mean_lifetime_s


def _idle(
    table: Party | Sensors | Fault, chosen: tuple[str, str], users: Mapping[str, set[str]]
) -> Iterator[str]:
    """Say which keys are given and would do nothing, because they are for another choice."""
    key, choice = chosen
    for name, choices in users.items():
        given = getattr(table, name) != type(table).__dataclass_fields__[name].default
        if given and choice not in choices:
            yield f"{name}: found with {key} {choice!r}; it is for {_listed(choices)}"


def _fault(scenario: Scenario, fault: Fault) -> Iterator[str]:
    yield from _idle(fault, ("kind", fault.kind), _FAULT_KEYS)
    if fault.to_s is not None and fault.to_s <= fault.from_s:
        yield f"to_s: found {fault.to_s:g}, expected a time after from_s = {fault.from_s:g}"
    if fault.group is not None and fault.group not in {group.id for group in scenario.groups}:
        known = ", ".join(group.id for group in scenario.groups) or "none"
        yield f"group: found {fault.group!r}, expected one of the groups: {known}"
    count = sensor_count(scenario)
    names = set(sensor_names(count))
    for name in fault.sensors:
        if name not in names:
            yield f"sensors: found {name!r}, expected sensors from s0 to s{count - 1}"
    if fault.count > count:
        yield f"count: found {fault.count}, expected at most the {count} sensors"
    whom = [fault.group is not None, bool(fault.sensors), fault.count > 0]
    if fault.kind == "burst":
        if any(whom):
            yield "kind: found 'burst' of some nodes, expected neither group, sensors nor count"
        if scenario.reports is None and scenario.detection is None:
            yield "kind: found 'burst' without [reports] or [detection]"
    elif sum(whom) != 1:
        yield f"kind: found {fault.kind!r}, expected one of group, sensors and count with it"
    if fault.kind == "stuck" and not {*scenario.models} & {"signal", "detection", "amplitude"}:
        yield "kind: found 'stuck' without [signal], [detection] or [amplitude]"
    if fault.kind == "stuck" and scenario.detection is not None and fault.value not in {0.0, 1.0}:
        yield f"value: found {fault.value:g}, expected 0 or 1 of a detection"


def _listed(names: set[str]) -> str:
    return " and ".join(repr(name) for name in sorted(names))
