"""What a coordinator of pursuers is told: how it chooses, and whom it does not trust."""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

import numpy as np

from trackfield.errors import ConfigurationError
from trackfield.pursuit.assignment import Objective

OBJECTIVES: tuple[Objective, ...] = get_args(Objective)


@dataclass(frozen=True, slots=True)
class PursuitSettings:
    """How pursuers are sent.

    Orders are for `step_s`. Who chases whom is the best by `objective`, and kept until another
    choice ends sooner by the part `margin`; with `double`, who is left over helps. Evaders are
    taken to accelerate by `evader_accel_m_s2`, a standard deviation of an axis, and by twice that
    at worst; where a track says they are is in doubt by `doubt_sigmas` of its deviations. A track
    is chased while its position is known to `most_sigma_m` on both axes and its last row is no
    older than `forget_s`.
    """

    step_s: float = 1.0
    objective: Objective = "bottleneck"
    margin: float = 0.1
    double: bool = True
    evader_accel_m_s2: float = 0.1
    doubt_sigmas: float = 0.5
    most_sigma_m: float = 10.0
    forget_s: float = 10.0

    def __post_init__(self) -> None:
        """Refuse what makes no sense, all of it at once."""
        kinds = {
            "a finite number above 0": ("step_s", "most_sigma_m", "forget_s"),
            "a finite number of 0 or more": ("evader_accel_m_s2", "doubt_sigmas"),
            "a part from 0 to below 1": ("margin",),
        }
        problems: list[str] = []
        for expected, names in kinds.items():
            for name in names:
                value: float = getattr(self, name)
                low = value > 0.0 if "above" in expected else value >= 0.0
                if not (np.isfinite(value) and low and (name != "margin" or value < 1.0)):
                    problems.append(f"{name}: found {value}, expected {expected}")
        if self.objective not in OBJECTIVES:
            known = ", ".join(OBJECTIVES)
            problems.append(f"objective: found {self.objective!r}, expected one of {known}")
        if problems:
            raise ConfigurationError(problems)
