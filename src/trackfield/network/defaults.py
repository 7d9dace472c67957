"""Which settings a site gives, which are defaults, and which are learned or derived from data."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, Literal, NamedTuple

from trackfield.network.channel import Channel
from trackfield.network.energy import Energy
from trackfield.network.kinds import KINDS, kind_of
from trackfield.network.site import (
    ReportSettings,
    Robot,
    SchedulingSettings,
    Site,
    Target,
    TrackerSettings,
)

Source = Literal["given", "default", "learned", "derived"]
_DERIVED = frozenset(  # from data or sensors, when it is needed
    {
        "reports.region",
        "reports.step_s",
        "scheduling.bound_m2",
        "scheduling.reach_m",
        "scheduling.ahead_s",
        "robot.comm_m",
        "robot.sensing_m",
    }
)
_OPEN_TARGET = "target.births_per_s"  # what is learned of targets if not given


class Setting(NamedTuple):
    """A value that applies, and where it comes from.

    What is learned on line, or derived from the data, has no value yet. A parameter in which
    sensors differ has `value` None and `low` to `high`.
    """

    value: Any
    source: Source
    low: float | None = None
    high: float | None = None

    @property
    def text(self) -> str:
        """The value as a person reads it."""
        if self.low is not None:
            return f"{self.low:.4g} to {self.high:.4g}"
        match self.value:
            case None:
                return "-" if self.source in ("learned", "derived") else "none"
            case bool():
                return str(self.value).lower()
            case float():
                return "unlimited" if self.value == math.inf else f"{self.value:.4g}"
            case _:
                return _listed(self.value)

    def to_json(self) -> dict[str, Any]:
        """Say it in JSON; a limit that is off is null."""
        value = None if self.value == math.inf else self.value
        span = {} if self.low is None else {"low": self.low, "high": self.high}
        return {"value": value, "source": self.source, **span}


def settings(site: Site) -> Mapping[str, Setting]:
    """All settings of `site` by key, models as `models.NAME.KEY` over the sensors of each."""
    names = names_of_models(site)
    found: dict[str, Setting] = {}
    for name in dict.fromkeys(names):
        models = [model for n, model in zip(names, site.models, strict=True) if n == name]
        own = [asdict(model) for model in models]
        for key, usual in asdict(KINDS[kind_of(models[0])].usual).items():
            found[f"models.{name}.{key}"] = _over([values[key] for values in own], usual)
    for section, given, usual in (
        ("target", site.target, Target()),
        ("tracker", site.tracker, TrackerSettings()),
        ("reports", site.reports, ReportSettings()),
        ("scheduling", site.scheduling, SchedulingSettings()),
        ("energy", site.energy, Energy()),
        *([("robot", site.robot, Robot())] if site.robot != Robot() else []),
        *([("network", site.network, Channel())] if site.network is not None else []),
    ):
        defaults = asdict(usual)
        for key, value in asdict(given).items():
            name = f"{section}.{key}"
            found[name] = Setting(value, _source(name, value, defaults[key]))
    return found


def names_of_models(site: Site) -> tuple[str, ...]:
    """Name each sensor's model; where the site names none, by its kind."""
    return site.model_names or tuple(kind_of(model) for model in site.models)


def _source(name: str, value: object, usual: object) -> Source:
    if value != usual:
        return "given"
    if value is None and name in _DERIVED:
        return "derived"
    if value is None and (name.startswith("reports.") or name == _OPEN_TARGET):
        return "learned"
    return "default"


def _over(values: list[Any], usual: Any) -> Setting:  # noqa: ANN401 - of any parameter
    if all(value == values[0] for value in values):
        return Setting(values[0], "default" if values[0] == usual else "given")
    if isinstance(usual, bool | tuple) or None in values:
        return Setting("differs between sensors", "given")
    return Setting(None, "given", low=min(values), high=max(values))


def _listed(value: Any) -> str:  # noqa: ANN401 - of any parameter
    """Write the numbers of a region, or how many corners there are; a word as it is."""
    match value:
        case (float(), *_):
            return ", ".join(f"{one:.4g}" for one in value)
        case () | (tuple(), *_):
            return f"{len(value)} corners"
        case _:
            return str(value)
