"""Golden kinds of motion sensors, Cheng, Ghosh, Hu."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from trackfield.scheduling import sensor_switching

Case = dict[str, Any]
Answer = dict[str, Any]


def motion_switching(given: Case) -> Answer:
    r, old, new = (np.array(given[name], float) for name in ("r", "old", "new"))
    return sensor_switching.switching_cost(r, old, new)._asdict()


KINDS: dict[str, Callable[[Case], Answer]] = {
    "motion_switching": motion_switching,
}
