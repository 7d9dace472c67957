"""A site written as TOML, so that reading it again gives the same site."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from trackfield.errors import InputError
from trackfield.network.channel import Channel
from trackfield.network.defaults import names_of_models
from trackfield.network.energy import Energy
from trackfield.network.kinds import KINDS, SensorModel, kind_of
from trackfield.network.sensors_file import read_text, sensors_from_csv
from trackfield.network.site import (
    Group,
    Origin,
    ReportSettings,
    Robot,
    SchedulingSettings,
    Site,
    Target,
    TrackerSettings,
)

_Table = dict[str, Any]
_Value = float | bool | tuple[Any, ...] | None
_Parameters = dict[str, _Value]


def write_site(site: Site, path: str | Path, *, comment: str = "") -> None:
    """Write `site` to `path`, whole or not at all; `InputError` if that cannot be.

    Sensors that came from a file stay in a file: that of the same name beside the written site if
    there is one (the same kit, set up elsewhere), else the one they came from.
    """
    path = Path(path)
    text = "".join(f"# {line}\n" for line in comment.splitlines()) + site_text(site, path.parent)
    part = path.with_name(f".{path.name}.part")
    try:
        part.write_text(text, encoding="utf-8")
        part.replace(path)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None


def site_text(site: Site, folder: Path) -> str:
    """TOML of `site` as a file in `folder`; `site_from_toml` makes an equal site of it."""
    head: _Table = {"name": site.name, "frame": "local"}
    if site.origin is not None:
        head["origin"] = _given(asdict(site.origin), Origin)
    document: _Table = {"site": head}
    known = frozenset(site.sensor_ids)
    if site.sensors_file is None:
        document["sensors"] = _sensors(site)
    else:
        file = sensors_file_for(site.sensors_file, folder)
        head["sensors_file"] = relative_path(file, folder)
        if file != site.sensors_file:
            there, _ = sensors_from_csv(read_text(file)[0], file.name)
            known = frozenset(sensor.sensor_id for sensor in there)
    if site.survey_file is not None and _same_place(site, folder):
        head["survey_file"] = relative_path(site.survey_file, folder)
    document["models"] = _models(site, known)
    document["target"] = _given(asdict(site.target), Target)
    document["tracker"] = _given(asdict(site.tracker), TrackerSettings)
    document["reports"] = _given(asdict(site.reports), ReportSettings)
    if site.network is not None:
        document["network"] = _given(asdict(site.network), Channel)
    document["scheduling"] = _given(asdict(site.scheduling), SchedulingSettings)
    document["energy"] = _given(asdict(site.energy), Energy)
    document["robot"] = _given(asdict(site.robot), Robot)
    document["obstacles"] = [asdict(obstacle) for obstacle in site.obstacles]
    document["rooms"] = [asdict(room) for room in site.rooms]
    document["groups"] = [_given(asdict(group), Group) for group in site.groups]
    # An empty [reports] says that no sensors are needed, an empty [network] that there is one.
    said = {"network"} if site.sensor_ids else {"network", "reports"}
    return tomli_w.dumps({k: v for k, v in document.items() if v or k in said})


def sensors_file_for(file: Path, folder: Path) -> Path:
    """Choose the file that a site in `folder` takes its sensors from: one beside it, or `file`."""
    beside = folder / file.name
    return beside if beside.is_file() and not beside.samefile(file) else file


def _same_place(site: Site, folder: Path) -> bool:
    """Tell if a site in `folder` has its sensors where `site` has them: else no survey is of it."""
    file = site.sensors_file
    return file is None or sensors_file_for(file, folder) == file


def relative_path(file: Path, folder: Path) -> str:
    """How `folder` names `file`: "../a/b.csv"; the full path where they share no root."""
    file, folder = file.resolve(), folder.resolve()
    if file.anchor != folder.anchor:
        return file.as_posix()
    shared = 0
    for ours, theirs in zip(file.parts, folder.parts, strict=False):
        if ours != theirs:
            break
        shared += 1
    up = [".."] * (len(folder.parts) - shared)
    return "/".join([*up, *file.parts[shared:]])


def _given(values: _Table, cls: type) -> _Table:
    """Those of the values that are not the defaults of dataclass `cls`."""
    default = {field.name: field.default for field in fields(cls)}
    return {key: value for key, value in values.items() if value != default[key]}


def _sensors(site: Site) -> list[_Table]:
    names, groups = names_of_models(site), site.sensor_groups or (None,) * len(site.sensor_ids)
    several = len(set(names)) > 1
    tables: list[_Table] = []
    for sensor_id, position, name, group in zip(
        site.sensor_ids, site.positions, names, groups, strict=True
    ):
        x, y, z = (float(c) for c in position)
        table: _Table = {"sensor_id": sensor_id, "x_m": x, "y_m": y}
        table |= {} if math.isnan(z) else {"z_m": z}
        table |= {"model": name} if several else {}
        table |= {} if group is None else {"group": group}
        tables.append(table)
    return tables


def _models(site: Site, known: frozenset[str]) -> _Table:
    """`[models.NAME]` with what most of its sensors share; what differs stands with the sensor.

    What a target has of its own stands under it, with its sensors. Sensors that are not `known`
    have no say of their own.
    """
    members: dict[str, list[int]] = {}
    for i, name in enumerate(names_of_models(site)):
        members.setdefault(name, []).append(i)
    tables: _Table = {}
    for name, places in members.items():
        ids = [site.sensor_ids[i] for i in places]
        values = [_parameters(site.models[i]) for i in places]
        common = {key: _typical([given[key] for given in values]) for key in values[0]}
        table = _shared(ids, [common] * len(ids), values, known=known)
        kind = kind_of(site.models[places[0]])
        if KINDS[kind].tagged:
            table["targets"] = {
                target: _shared(ids, values, [_parameters(models[i]) for i in places], known=known)
                for target, models in site.target_models.items()
            }
        # What is off by default and off here need not be said.
        usual = _parameters(KINDS[kind].usual)
        common = {
            k: v for k, v in common.items() if v is not None and not v == usual[k] in (math.inf, ())
        }
        tables[name] = {"kind": kind, **common, **{k: v for k, v in table.items() if v}}
    return tables


def _shared(
    ids: list[str],
    above: list[_Parameters],
    wanted: list[_Parameters],
    *,
    known: frozenset[str],
) -> _Table:
    """Tell what sensors `ids` have in place of what stands `above`: shared first, then own."""
    keys = wanted[0].keys()
    same = {k: wanted[0][k] for k in keys if all(own[k] == wanted[0][k] for own in wanted)}
    shared = {k: v for k, v in same.items() if any(up[k] != v for up in above)}
    own = {
        sensor_id: {k: v for k, v in values.items() if v != {**up, **shared}[k]}
        for sensor_id, up, values in zip(ids, above, wanted, strict=True)
    }
    sensors = {name: values for name, values in own.items() if values and name in known}
    return {**shared, **({"sensors": sensors} if sensors else {})}


def _parameters(model: SensorModel) -> _Parameters:
    """Parameters as plain values of TOML."""
    return {
        key: value.item() if isinstance(value, np.generic) else value
        for key, value in asdict(model).items()
    }


def _typical(values: list[_Value]) -> _Value:
    """Find what most share, else the middle one: a fair guess for a sensor that joins later."""
    given = sorted(value for value in values if value is not None)
    if len(given) < len(values):  # TOML has no None: what one sensor leaves out, all leave out
        return None
    value, count = Counter(given).most_common(1)[0]
    return value if 2 * count > len(given) else given[(len(given) - 1) // 2]
