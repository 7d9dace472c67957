"""What is believed of one pass: its trajectories with weights, by messages, and by all samples."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, cast

import numpy as np

from trackfield.filtering.scans import Shown
from trackfield.linalg import cholesky
from trackfield.localization.pass_fusion import (
    LEAST_SENSORS,
    PASS_REASONS,
    SURE,
    VAGUE,
    Passes,
    PassSettings,
    PassVerdict,
    fuse,
)
from trackfield.localization.pass_raw import RawFit, RawPass, fits
from trackfield.localization.pass_raw_starts import (
    flipped_starts,
    possible_starts,
    searched_starts,
)
from trackfield.localization.pass_stream import SensorMessage, together
from trackfield.types import Matrix, Status, Vector

MOST_MISFIT = (
    4.0  # standard deviations by which samples of one pass may differ more than on average
)
_LEAST_WEIGHT = 0.02  # of a trajectory that is worth a row
_MOST_MODES = 4
_FEW = 6  # messages of which all pairs are starts: mirror images are not to be missed
_THOROUGH = PassSettings(starts="all", searches=24)
_MOST_SEARCHED = 3000  # samples with which other trajectories are looked for all over
_WITHIN = 12.0  # log-likelihood by which a trajectory may be worse than the best
_SEEN = 0.25  # widths of a pass that a record must hold on both sides of the closest approach
_SAME = 1.0  # squared distance of two ends of a search that are one


class PassMode(NamedTuple):
    """One trajectory: `theta` (5,) = P, position at the belief's `start_s`, velocity; its share."""

    theta: Vector
    covariance: Matrix
    weight: float


class PassBelief(NamedTuple):
    """All trajectories that explain one pass, the likeliest first.

    `by_samples` says that all samples were used, not only what sensors made of them.
    """

    start_s: float
    modes: tuple[PassMode, ...]
    verdict: PassVerdict
    by_samples: bool = False

    @property
    def reason(self) -> str:
        """What the verdict says, in a sentence."""
        return PASS_REASONS[self.verdict]

    def places(self, t_s: float) -> Matrix:
        """Where each trajectory is at a time, (modes, 2) [m]."""
        ahead = t_s - self.start_s
        places = [mode.theta[1:3] + ahead * mode.theta[3:5] for mode in self.modes]
        return np.array(places).reshape(-1, 2)

    def shown(self, t_s: float) -> list[Shown]:
        """Rows at a time: one if a trajectory is sure, else a tentative one for each."""
        sure = self.verdict == PassVerdict.GOOD
        status = Status.CONFIRMED if sure else Status.TENTATIVE
        return [self._shown(mode, t_s, status) for mode in self.modes[: 1 if sure else _MOST_MODES]]

    def _shown(self, mode: PassMode, t_s: float, status: Status) -> Shown:
        ahead = t_s - self.start_s
        G = np.zeros((2, 5))
        G[0, 1] = G[1, 2] = 1.0
        G[0, 3] = G[1, 4] = ahead
        C = G @ mode.covariance @ G.T
        x, y = (mode.theta[1:3] + ahead * mode.theta[3:5]).tolist()
        vx, vy = mode.theta[3:5].tolist()
        return Shown(
            t_s,
            np.array([x, y, math.nan]),
            np.array([vx, vy, math.nan]),
            np.array([C[0, 0], C[0, 1], C[1, 1]]),
            status,
            math.nan,
        )


UNKNOWN = PassBelief(0.0, (), PassVerdict.NOTHING)
"""What is believed before anything is."""


def by_messages(
    messages: Sequence[SensorMessage], *, doubtful: Sequence[SensorMessage] = ()
) -> PassBelief:
    """Fuse messages of one pass; positions are told at the middle of what they say.

    Nothing is sure unless three sensors had the closest approach in their records: a profile that
    is only the beginning or the end of a pass says less than its numbers pretend. Those `doubtful`
    ones among them that may be of something else make nothing sure either.
    """
    start_s = float(np.median([float(m.profile.t_max_s) for m in messages]))
    settings = _THOROUGH if len(messages) <= _FEW else None
    found = belief_of(fuse(together(messages, start_s=start_s), settings=settings), start_s)
    if (
        len({(m.x_m, m.y_m) for m in messages if _saw_it_pass(m) and m not in doubtful})
        < LEAST_SENSORS
    ):
        return found._replace(verdict=max(found.verdict, PassVerdict.UNCERTAIN))
    return found


def _saw_it_pass(message: SensorMessage) -> bool:
    """Tell whether a record holds the closest approach, with some of the rise and of the fall."""
    first_s, end_s = message.first_s, message.first_s + message.step_s * (message.samples - 1)
    margin_s = _SEEN * float(message.profile.width_s)
    inside = first_s + margin_s <= float(message.profile.t_max_s) <= end_s - margin_s
    return bool(message.profile.a_max > 0.0 and inside)


def belief_of(passes: Passes, start_s: float) -> PassBelief:
    """Keep what is worth telling of fused passes."""
    shares = passes.weight.tolist()
    modes = tuple(
        PassMode(theta, covariance[:5, :5], weight)
        for theta, covariance, weight in zip(passes.theta, passes.covariance, shares, strict=True)
        if weight >= _LEAST_WEIGHT and np.isfinite(theta).all() and np.isfinite(covariance).all()
    )
    return PassBelief(start_s, modes, passes.verdict)


def by_samples(belief: PassBelief, raw: RawPass) -> PassBelief:
    """Go on from trajectories to the maximum of the likelihood of all samples.

    The weights are Laplace's. Without a good fit the trajectories stay, but none of them is to be
    believed: the samples hold more than a straight pass of one source.
    """
    if not belief.modes or not raw.t_s.size:
        return belief
    doubted = belief._replace(verdict=max(belief.verdict, PassVerdict.CONTRADICTORY))
    ends = _ends(raw._replace(start_s=belief.start_s), belief)
    if not ends:
        return doubted
    kept: list[RawFit] = []
    for end in ends:  # best first
        good = end.converged and end.determined and end.misfit < MOST_MISFIT
        if good and not any(_same(end, other) for other in kept):
            kept.append(end)
    if not kept or kept[0] is not ends[0]:
        return doubted
    logs = np.array([_log_weight(end, raw.sensors) for end in kept])
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    modes = [
        PassMode(end.theta, end.covariance, weight)
        for end, weight in zip(kept, weights.tolist(), strict=True)
        if weight >= _LEAST_WEIGHT
    ]
    modes.sort(key=lambda mode: -mode.weight)
    verdict = belief.verdict
    if _vague(modes[0]):
        verdict = max(verdict, PassVerdict.UNCERTAIN)
    elif verdict in (PassVerdict.GOOD, PassVerdict.AMBIGUOUS):
        verdict = PassVerdict.GOOD if modes[0].weight >= SURE else PassVerdict.AMBIGUOUS
    return PassBelief(belief.start_s, tuple(modes), verdict, by_samples=True)


def _ends(given: RawPass, belief: PassBelief) -> tuple[RawFit, ...]:
    """Find maxima of the likelihood, best first, from what is believed.

    Where there are few samples also from all over, and from the other side of each sensor.
    """
    starts = possible_starts(np.array([mode.theta for mode in belief.modes]))
    if not len(starts):
        return ()
    if given.t_s.size > _MOST_SEARCHED:
        return fits(given, starts, within=_WITHIN)
    ends = fits(given, searched_starts(given, starts), within=_WITHIN)
    found = possible_starts(np.array([end.theta for end in ends]))
    sides = possible_starts(flipped_starts(given, found[:2]))
    return fits(given, np.concatenate([found, sides]), within=_WITHIN) if len(found) else ()


def packed(belief: PassBelief) -> list[Any]:
    """Plain numbers of a belief; those of JSON come back exactly."""
    modes = [[m.theta.tolist(), m.covariance.tolist(), m.weight] for m in belief.modes]
    return [belief.start_s, modes, int(belief.verdict), belief.by_samples]


def unpacked(plain: list[Any]) -> PassBelief:
    """Return the belief that was packed."""
    start_s, modes, verdict, by_all = plain
    known = tuple(
        PassMode(np.array(theta), np.array(covariance), float(weight))
        for theta, covariance, weight in cast("list[list[Any]]", modes)
    )
    return PassBelief(float(start_s), known, PassVerdict(verdict), bool(by_all))


def _same(one: RawFit, other: RawFit) -> bool:
    """Tell whether two searches ended at one place."""
    e = one.theta - other.theta
    unit = np.sqrt(np.diag(other.covariance))
    L, ok = cholesky(other.covariance / np.outer(unit, unit))
    white = np.linalg.solve(L, e / unit)
    return bool(ok) and float(white @ white) < _SAME


def _vague(mode: PassMode) -> bool:
    """Tell whether power or velocity are so uncertain that a covariance says little."""
    speed = max(float(np.hypot(*mode.theta[3:5])), 1e-300)
    v = mode.theta[3:5] / speed
    along = np.array([v, [-v[1], v[0]]])
    spread = np.asarray(np.diag(along @ mode.covariance[3:5, 3:5] @ along.T), float) / speed**2
    power = mode.covariance[0, 0] / (2.0 * max(float(mode.theta[0]), 1e-300)) ** 2
    return bool(max(float(np.max(spread)), float(power)) > VAGUE**2)


def _log_weight(end: RawFit, sensors: Matrix) -> float:
    """Laplace's log weight of a trajectory, under the prior of `pass_fusion.fuse`."""
    unit = np.sqrt(np.diag(end.covariance))
    L = cholesky(end.covariance / np.outer(unit, unit)).value
    volume = float(np.sum(np.log(np.diag(L)))) + float(np.sum(np.log(unit)))
    volume -= math.log(float(end.theta[0]))  # of log power
    middle = np.asarray(sensors.mean(axis=0), float)
    apart = np.linalg.norm(sensors - middle, axis=1)
    square = max(float(apart @ apart) / apart.size, 1e-300)
    vx, vy = end.theta[3:5].tolist()
    speed = max(math.hypot(vx, vy), 1e-300)
    x, y = (end.theta[1:3] - middle).tolist()
    aside = (x * vy - y * vx) / speed
    return volume - end.cost - 3.0 * math.log(speed) - 0.5 * aside**2 / square
