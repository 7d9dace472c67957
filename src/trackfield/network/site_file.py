"""A site's TOML file: read with every fault listed at once, written back with what was learned."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any, cast

import numpy as np

from trackfield.errors import ConfigurationError
from trackfield.network.channel import Channel
from trackfield.network.energy import Energy
from trackfield.network.faults import find_faults, nearest, path_text
from trackfield.network.kinds import KINDS, SensorModel
from trackfield.network.sensors_file import (
    Sensor,
    read_text,
    repeated_sensors,
    sensors_from_csv,
    sensors_from_tables,
)
from trackfield.network.site import (
    Group,
    Obstacle,
    Origin,
    ReportSettings,
    Robot,
    Room,
    SchedulingSettings,
    Site,
    Target,
    TrackerSettings,
)
from trackfield.network.site_parts import (
    group_problems,
    obstacle_problems,
    region_problems,
    room_problems,
    survey_of,
    target_problems,
)
from trackfield.network.site_schema import SITE_FILE
from trackfield.raster import Region
from trackfield.sensing.detection import DetectionModel
from trackfield.sensing.range import RangeModel
from trackfield.sensing.rssi import RssiModel

DEFAULT_MODEL = "range"
_Table = Mapping[str, Any]
_TABLES = ("kind", "sensors", "targets")  # in a `[models.NAME]`, what is no parameter


def load_site(path: str | Path) -> Site:
    """Read a site's file and the sensors' file it names; `ConfigurationError` lists all faults."""
    path = Path(path)
    text, problems = read_text(path)
    if problems:
        raise ConfigurationError(problems)
    return site_from_toml(text, path.parent, str(path))


def site_from_toml(text: str, folder: Path, name: str = "site.toml") -> Site:
    """Read the site that `text` says; its sensors' file is looked for in `folder`.

    `name` is what messages call the file. `ConfigurationError` lists all faults.
    """
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigurationError([f"{name}: not TOML: {error}"]) from None
    listed, file = document.pop("sensors", None), _sensors_file(document)
    faults = find_faults(SITE_FILE, document)
    problems = [f"{name}: {path_text(path)}: {sentence}" for path, sentence in faults]
    models, text_sections = _names_of_models(document), frozenset(document)
    faulty = {path[0] for path, _ in faults}
    # Sound sections are checked further even so, because all faults are told at once.
    sound = {key: value for key, value in document.items() if key not in faulty}
    document = SITE_FILE.model_validate(sound).model_dump(exclude_unset=True)

    sensors_file = folder / file if file is not None else None
    sensors, found = _sensors(listed, sensors_file, name)
    problems += [*found, *repeated_sensors(sensors)]
    needless = "reports" in text_sections or bool(faulty & {"site", "sensors_file"})
    if not (sensors or found or (needless and sensors_file is None)):
        expected = (
            "a line a sensor"
            if sensors_file
            else "[[sensors]], sensors_file = 'FILE.csv', or [reports] for data that are positions"
        )
        problems.append(f"{sensors_file or name}: found no sensors, expected {expected}")
    if listed is not None and file is not None:
        problems.append(f"{name}: found both [[sensors]] and sensors_file, expected one of them")
    problems += _model_problems(sensors, models, name)
    if not found:  # else a sensor may only seem to be unknown
        problems += _own_problems(sensors, document.get("models", {}), name)
    if "groups" not in faulty:
        problems += group_problems(sensors, document.get("groups", []), name)
    problems += target_problems(sensors, document.get("target", {}), name)
    problems += region_problems(document.get("reports", {}), name)
    problems += obstacle_problems(document.get("obstacles", []), name)
    problems += room_problems(document.get("rooms", []), name)
    survey, found = survey_of(document, sensors, folder, name)
    problems += found
    if problems:
        raise ConfigurationError(problems)
    site = _site(document, sensors, sensors_file, Path(name).stem)
    return site if survey is None else replace(site, survey=survey[0], survey_file=survey[1])


def _sensors_file(document: _Table) -> str | None:
    """Find the name of the sensors' file; it may stand in `[site]` or before all tables."""
    for table in (document.get("site"), document):
        if isinstance(table, Mapping):
            file = cast("_Table", table).get("sensors_file")
            if isinstance(file, str):
                return file
    return None


def _names_of_models(document: _Table) -> list[str]:
    """Find the names of the models, sound or not."""
    models = document.get("models")
    return list(cast("_Table", models)) if isinstance(models, Mapping) else []


def _sensors(listed: object, file: Path | None, name: str) -> tuple[list[Sensor], list[str]]:
    if listed is not None:
        return sensors_from_tables(listed, name)
    if file is None:
        return [], []
    text, problems = read_text(file)
    if problems:
        return [], [f"{name}: sensors_file: {problem}" for problem in problems]
    return sensors_from_csv(text, str(file))


def _model_problems(sensors: list[Sensor], models: list[str], name: str) -> Iterator[str]:
    """Models that are named and not there, and sensors that do not say which is theirs."""
    for sensor in sensors:
        if sensor.model is None and len(models) > 1:
            yield (
                f"{sensor.where}: model: {sensor.sensor_id!r} names no model, "
                f"expected one of: {', '.join(models)}"
            )
        elif sensor.model is not None and sensor.model not in models:
            yield (
                f"{sensor.where}: model: found {sensor.model!r}, expected a model of {name}; "
                f"{nearest(sensor.model, models)}"
            )


def _own_problems(sensors: list[Sensor], models: _Table, name: str) -> Iterator[str]:
    """Parameters of sensors that are not there or have another model, or that no range can have."""
    model_of = {s.sensor_id: s.model or next(iter(models), "") for s in sensors}
    for model, table in models.items():
        where = f"{name}: models.{model}"
        targets: _Table = table.get("targets", {})
        named = [(where, table)] + [(f"{where}.targets.{t}", own) for t, own in targets.items()]
        for path, own in named:
            for sensor_id in own.get("sensors", {}):
                here = f"{path}.sensors.{sensor_id}"
                if sensor_id not in model_of:
                    yield f"{here}: found an unknown sensor; {nearest(sensor_id, model_of)}"
                elif model_of[sensor_id] != model:
                    yield f"{here}: found a sensor of model {model_of[sensor_id]!r}"
        for sensor_id, target in product(
            [s for s, m in model_of.items() if m == model], (None, *targets)
        ):
            doubt = _doubt(believed(table["kind"], _given(table, sensor_id, target)), sensor_id)
            if doubt is not None:
                yield f"{where}: {doubt}"
                break


def _doubt(model: SensorModel, sensor_id: str) -> str | None:
    """Say why no sensor can have these parameters together; None if one can."""
    match model:
        case RangeModel(sigma_m=0, sigma_scale=0):
            return (
                f"found sigma_m = 0 and sigma_scale = 0 for {sensor_id!r}, "
                "expected one of them above 0: no range is exact"
            )
        case DetectionModel(p_detection=p, p_false=q) if q >= p:
            return (
                f"found p_false = {q:g} and p_detection = {p:g} for {sensor_id!r}, expected less "
                "false than true ones: else a detection says nothing"
            )
        case DetectionModel(polygon=corners) if 0 < len(corners) < 3:
            return f"polygon: found {len(corners)} corners for {sensor_id!r}, expected 3 or more"
        case RssiModel(sigma_db=all_of_it, fading_db=fading) if fading > all_of_it:
            return (
                f"found fading_db = {fading:g} and sigma_db = {all_of_it:g} for {sensor_id!r}, "
                "expected no more fading than noise: it is a part of it"
            )
        case RssiModel(p_blocked=p, p_outlier=q) if p + q >= 1.0:
            return (
                f"found p_blocked = {p:g} and p_outlier = {q:g} for {sensor_id!r}, "
                "expected less than 1 in all"
            )
        case _:
            return None


def believed(kind: str, given: _Table) -> SensorModel:
    """Make a model of the parameters that a person gave.

    What is told is believed: a bias, scale or noise that is given has no doubt but what is given
    with it. What is not told is as usual for the kind: of ranges doubted, and learned on line.
    """
    parameters, usual, _, _, doubts, *_ = KINDS[kind]
    settled = [doubt for key, of_key in doubts.items() if key in given for doubt in of_key]
    exact = {doubt: getattr(parameters(), doubt) for doubt in settled}
    return replace(usual, **{key: _fixed(value) for key, value in {**exact, **given}.items()})


def _fixed(value: Any) -> Any:  # noqa: ANN401 - of any key
    """Make tuples of lists."""
    if not isinstance(value, list):
        return value
    return tuple(_fixed(one) for one in cast("list[Any]", value))


def _given(model: _Table, sensor_id: str, target: str | None) -> dict[str, Any]:
    """Parameters that `model` gives a sensor, or the pair of it and a target; the nearest count."""
    nothing: _Table = {}
    of_target: _Table = model.get("targets", nothing).get(target, nothing)
    layers: list[_Table] = [
        model,
        model.get("sensors", nothing).get(sensor_id, nothing),
        of_target,
        of_target.get("sensors", nothing).get(sensor_id, nothing),
    ]
    return {k: v for layer in layers for k, v in layer.items() if k not in _TABLES}


def _site(document: _Table, sensors: list[Sensor], file: Path | None, stem: str) -> Site:
    models: _Table = document.get("models") or {DEFAULT_MODEL: {"kind": DEFAULT_MODEL}}
    names = [sensor.model or next(iter(models)) for sensor in sensors]

    def of(target: str | None) -> tuple[SensorModel, ...]:
        return tuple(
            believed(models[name]["kind"], _given(models[name], sensor.sensor_id, target))
            for name, sensor in zip(names, sensors, strict=True)
        )

    targets = {t: None for model in models.values() for t in model.get("targets", {})}
    site: _Table = document.get("site", {})
    reports = {key: _fixed(value) for key, value in document.get("reports", {}).items()}
    if "region" in reports:
        reports["region"] = Region(*reports["region"])
    return Site(
        name=site.get("name", stem),
        sensor_ids=tuple(sensor.sensor_id for sensor in sensors),
        positions=np.array([sensor.position for sensor in sensors]).reshape(-1, 3),
        models=of(None),
        target=Target(**document.get("target", {})),
        tracker=TrackerSettings(**document.get("tracker", {})),
        origin=Origin(**site["origin"]) if "origin" in site else None,
        groups=tuple(Group(**group) for group in document.get("groups", [])),
        model_names=tuple(names),
        sensor_groups=tuple(sensor.group for sensor in sensors),
        sensors_file=file,
        target_models={target: of(target) for target in targets},
        reports=ReportSettings(**reports),
        network=Channel(**document["network"]) if "network" in document else None,
        scheduling=SchedulingSettings(**document.get("scheduling", {})),
        energy=Energy(**document.get("energy", {})),
        robot=Robot(**document.get("robot", {})),
        obstacles=tuple(Obstacle(_fixed(one["polygon"])) for one in document.get("obstacles", [])),
        rooms=tuple(Room(one["id"], _fixed(one["polygon"])) for one in document.get("rooms", [])),
    )
