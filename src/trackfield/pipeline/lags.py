"""How late positions are wanted, in steps."""

from __future__ import annotations

import math

from trackfield.errors import ConfigurationError

_MOST_LAG = 1000  # steps that a window must then hold
_SLACK = 1e-9  # of a step


def require_lags(lag_s: float, lag_steps: int, *, every_s: float) -> None:
    """Raise `ConfigurationError` for lags and distances of rows that cannot be."""
    if not _sound(lag_s, lag_steps, every_s):
        raise ConfigurationError(
            [
                f"found lag_s {lag_s!r}, lag_steps {lag_steps!r}, every_s {every_s!r}, "
                "expected finite numbers, 0 or more, and whole steps"
            ]
        )


def lag_in_steps(lag_s: float, lag_steps: int, *, every_s: float, step_s: float) -> int:
    """Lag in steps; `ConfigurationError` for lags that cannot be."""
    sound = _sound(lag_s, lag_steps, every_s)
    steps = max(math.ceil(lag_s / step_s - _SLACK), int(lag_steps)) if sound else _MOST_LAG + 1
    if steps > _MOST_LAG:
        raise ConfigurationError(
            [
                f"found lag_s {lag_s!r}, lag_steps {lag_steps!r}, every_s {every_s!r}, expected "
                f"finite numbers, 0 or more, and whole steps: a lag of at most {_MOST_LAG} steps"
            ]
        )
    return steps


def _sound(lag_s: float, lag_steps: int, every_s: float) -> bool:
    try:
        finite = all(0 <= float(n) < math.inf for n in (lag_s, lag_steps, every_s))
        return finite and lag_steps == int(lag_steps)
    except (TypeError, ValueError):
        return False
