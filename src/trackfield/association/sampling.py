"""How partitions are sampled: settings of MCMCDA, and the compiled chain that they start."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from trackfield._core._mcmcda import Sampler
from trackfield.association.partition import Window
from trackfield.errors import ConfigurationError
from trackfield.types import Indices

MOVES = ("birth", "death", "split", "merge", "extension", "reduction", "update", "switch")
_MOST_SLOTS = 64
_MOST_LINKS = 60_000  # expected; the reach of links is cut until they are fewer


@dataclass(frozen=True, slots=True)
class Sampling:
    """Settings of MCMCDA; `Sampling.paper()` is the tracker as Oh prints it.

    `moves` a step; `window` and `reach` (the most slots from one report of a track to the next) in
    steps. Reports link up to `max_speed_m_s` (None: four sigmas of the targets' velocity) and
    `margin` sigmas of both. Tracks are told from the best partition ("map") or averaged over the
    sampled ones ("mean"), and shown above `show` existence; without `existence` they are shown
    while seen in the last `coast` steps. `freeze` keeps what the last step believed of the window's
    older half. `weights` say how often each of `MOVES` is tried. From `full_links` links on, moves
    get fewer, so that a crowd is never late.
    """

    moves: int = 1000
    window: int = 15
    reach: int = 6
    max_speed_m_s: float | None = None
    margin: float = 3.0
    informed: bool = True
    output: Literal["map", "mean"] = "map"
    existence: bool = True
    show: float = 0.5
    coast: int = 2
    freeze: bool = False
    stop: float = 0.1
    weights: tuple[float, ...] = (2.0, 0.4, 0.3, 1.0, 1.0, 0.3, 3.0, 0.5)
    samples: int = 50
    full_links: int = 20_000
    seed: int = 0

    @classmethod
    def paper(cls, *, seed: int = 0) -> Sampling:
        """Oh, IV.B: uniform proposals, 1000 moves, window 10, best partition, no existence."""
        alike = (1.0,) * len(MOVES)
        return cls(window=10, reach=5, informed=False, existence=False, weights=alike, seed=seed)


def check(sampling: Sampling) -> None:
    """Raise `ConfigurationError` that lists every setting that cannot be."""
    s = sampling
    wrong = [
        f"{name}: {getattr(s, name)!r}, expected {expected}"
        for name, fine, expected in (
            ("moves", s.moves >= 0, "a number of moves, 0 or more"),
            ("window", 2 <= s.window <= _MOST_SLOTS, f"2 to {_MOST_SLOTS} steps"),
            ("reach", 1 <= s.reach <= _MOST_SLOTS, f"1 to {_MOST_SLOTS} steps"),
            ("max_speed_m_s", s.max_speed_m_s is None or s.max_speed_m_s > 0, "a speed above 0"),
            ("margin", s.margin >= 0, "a number of sigmas, 0 or more"),
            ("show", 0 <= s.show <= 1, "a probability"),
            ("coast", s.coast >= 0, "a number of steps, 0 or more"),
            ("stop", 0 < s.stop < 1, "a probability between 0 and 1"),
            ("samples", s.samples >= 1, "1 or more"),
            ("full_links", s.full_links >= 1, "1 or more"),
            ("seed", s.seed >= 0, "0 or more"),
            (
                "weights",
                len(s.weights) == len(MOVES) and all(w > 0 for w in s.weights),
                f"{len(MOVES)} numbers above 0, of {', '.join(MOVES)}",
            ),
        )
        if not fine
    ]
    if wrong:
        raise ConfigurationError(wrong)


def gap_probabilities(reach: int, p_detection: float) -> list[float]:
    """Zeta: probability of the gaps 1..reach of a target that is seen with `p_detection`."""
    zeta = p_detection * (1.0 - p_detection) ** np.arange(reach)
    return [float(z) for z in zeta / zeta.sum()]


def start(window: Window, sampling: Sampling, *, owner: Indices, random: list[int]) -> Sampler:
    """Start a chain at `owner` (n,), the track of each report or -1; `random` is four words."""
    life, s = window.life, sampling
    speed = s.max_speed_m_s or 4.0 * life.velocity_sigma_m_s
    reach = _affordable_reach(window, s, speed)
    infinite = float("inf")
    settings = {
        "velocity_variance": life.velocity_sigma_m_s**2,
        "accel_variance": life.accel_sigma_m_s2**2,
        "step": life.step_s,
        "max_speed": speed,
        "margin": s.margin,
        "stop": s.stop,
        "gaps": gap_probabilities(reach, _settled_detection(window)),
        "moves": list(s.weights),
        "informed": s.informed,
        "marginal_death": life.log_death is None,
        "log_death": life.log_death or 0.0,
        "region": list(life.region or (-infinite, -infinite, infinite, infinite)),
        "frozen": window.t_s.size // 2 if s.freeze else 0,
    }
    reports = np.column_stack(
        [window.position, window.covariance, window.log_birth, window.log_false]
    )
    return Sampler(
        settings,
        window.slot,
        reports,
        window.t_s,
        window.survival,
        np.ascontiguousarray(window.p_detection),
        owner,
        random,
    )


def _settled_detection(window: Window) -> float:
    """Average the probability that a target has been reported once nothing can be late."""
    return float(window.p_detection[0].mean()) if len(window) else 0.5


def _affordable_reach(window: Window, sampling: Sampling, speed_m_s: float) -> int:
    """Reach within which the links expected of reports spread over the region stay few enough."""
    slots = window.t_s.size
    counts = np.bincount(window.slot, minlength=slots).astype(float)
    spread = 0.0
    if len(window):
        width, height = window.position.max(axis=0) - window.position.min(axis=0)
        spread = float(width * height)
    links, reach = 0.0, 1
    for d in range(1, min(sampling.reach, slots - 1) + 1):
        pairs = counts[:-d] * counts[d:]
        radius = speed_m_s * (window.t_s[d:] - window.t_s[:-d])
        links += float((pairs * np.minimum(1.0, np.pi * radius**2 / max(spread, 1e-9))).sum())
        if d > 1 and links > _MOST_LINKS:
            break
        reach = d
    return reach
