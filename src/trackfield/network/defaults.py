"""Which settings a site gives and which it leaves to the defaults."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, NamedTuple

from trackfield.network.site import Site, Target, TrackerSettings
from trackfield.sensing.range import UNCALIBRATED


class Setting(NamedTuple):
    """A value that applies, and whether it is the default.

    A parameter in which sensors differ has `value` None and `low` to `high`.
    """

    value: Any
    default: bool
    low: float | None = None
    high: float | None = None

    @property
    def text(self) -> str:
        """The value as a person reads it."""
        if self.low is not None:
            return f"{self.low:.4g} to {self.high:.4g}"
        match self.value:
            case None:
                return "none"
            case bool():
                return str(self.value).lower()
            case float():
                return "unlimited" if self.value == math.inf else f"{self.value:.4g}"
            case _:
                return str(self.value)

    def to_json(self) -> dict[str, Any]:
        """Say it in JSON; a limit that is off is null."""
        value = None if self.value == math.inf else self.value
        span = {} if self.low is None else {"low": self.low, "high": self.high}
        return {"value": value, "default": self.default, **span}


def settings(site: Site) -> Mapping[str, Setting]:
    """All settings of `site` by key, models as `models.NAME.KEY` over the sensors of each."""
    names = site.model_names or ("range",) * len(site.sensor_ids)
    found: dict[str, Setting] = {}
    for name in dict.fromkeys(names):
        own = [asdict(m) for n, m in zip(names, site.models, strict=True) if n == name]
        for key, usual in asdict(UNCALIBRATED).items():
            found[f"models.{name}.{key}"] = _over([values[key] for values in own], usual)
    for section, given, usual in (
        ("target", asdict(site.target), asdict(Target())),
        ("tracker", asdict(site.tracker), asdict(TrackerSettings())),
    ):
        for key, value in given.items():
            found[f"{section}.{key}"] = Setting(value, value == usual[key])
    return found


def _over(values: list[Any], usual: float | bool | None) -> Setting:
    if all(value == values[0] for value in values):
        return Setting(values[0], values[0] == usual)
    if isinstance(usual, bool) or None in values:
        return Setting("differs between sensors", default=False)
    return Setting(None, default=False, low=min(values), high=max(values))
