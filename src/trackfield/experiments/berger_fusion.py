"""Berger, Figs. 7, 8, 11, 12: the fusion center against its bound, the paper's way and ours."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trackfield.experiments import berger_fusion_tables
from trackfield.experiments.berger_fusion_tables import (
    COUNTS,
    METHODS,
    PARTS,
    BergerFusion,
    FusionErrors,
    FusionPart,
    GroupingScore,
)
from trackfield.experiments.results import Table
from trackfield.localization.pass_bounds import pass_bound
from trackfield.localization.pass_fusion import Passes, fuse, fuse_as_printed
from trackfield.localization.pass_groups import group
from trackfield.localization.pass_messages import PassMessages, common_records, fishers
from trackfield.localization.pass_raw import RawPass, fits
from trackfield.sensing import amplitude
from trackfield.sensing.amplitude import AmplitudeModel
from trackfield.sensing.pass_profile import predict
from trackfield.sensing.profile import expected
from trackfield.sensing.profile_fit import fit
from trackfield.types import Matrix, Vector

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LAYOUT_KM = np.array(
    [
        *[(-1.20, 0.80), (0.95, -0.85), (0.25, 0.45), (-0.60, -1.10), (1.40, 0.90)],
        *[(-1.70, -1.50), (-0.30, 1.60), (1.75, -0.30), (0.30, -1.75), (-1.85, 0.15)],
        *[(-1.50, 1.75), (0.70, 1.30), (1.80, 1.80), (1.60, -1.60), (-1.05, -0.45)],
        *[(-0.35, 0.30), (0.55, -0.25), (1.10, -0.15), (-1.25, -1.90), (0.15, 1.95)],
    ]
)
"""Ours, of the paper's size: the paper draws its twenty sensors and prints no places."""
THETA = np.array([1.0, -2.4, -0.5, 0.196, 0.04])  # P at 1 km, x0 [km], v [km/s]
OTHERS = np.array([[1.0, 2.2, 1.2, -0.18, -0.086], [0.5, -0.9, -2.4, 0.05, 0.2]])
"""Two more targets at the same time, the first as loud and as fast: of the same invariant."""
RECORD_S = 24.0
OUTLIER = 5.0  # bounds of x0 from which on an estimate is a mirror image, or lost
Tick = Callable[[], None]


class _Heard(NamedTuple):
    """What twenty sensors heard in one run: samples (20, m), and their messages (20, 3).

    `printed` are those of the paper's sensors, which fit from the coarse estimate alone.
    """

    t_s: Vector
    model: AmplitudeModel
    values: Matrix
    profiles: Matrix
    printed: Matrix


def run(
    rng: np.random.Generator, *, quick: bool = False, tick: Tick = lambda: None
) -> BergerFusion:
    """Run every part of `PARTS` at every SNR, 150 times (8 if `quick`); the paper takes 1000."""
    runs = 8 if quick else 150
    errors = {name: _errors(part, runs, rng, tick) for name, part in PARTS.items()}
    return BergerFusion(errors, _grouping(1 if quick else 20, rng), runs)


def ticks() -> int:
    """How often `run` calls its `tick`."""
    return sum(len(part.snr_db) for part in PARTS.values())


def tables(found: BergerFusion) -> tuple[Table, ...]:
    """Tell errors against the bound, and how often each way is lost."""
    return berger_fusion_tables.tables(found)


def findings(found: BergerFusion) -> tuple[str, ...]:
    """Say what follows, and what could not be recovered."""
    return berger_fusion_tables.findings(found)


def figures(found: BergerFusion) -> dict[str, Figure]:
    """Draw Figs. 7, 8, 11 and 12 with Matplotlib, by file name."""
    from trackfield.experiments.berger_fusion_figures import figures

    return figures(found)


def _errors(part: FusionPart, runs: int, rng: np.random.Generator, tick: Tick) -> FusionErrors:
    shape = (len(COUNTS), len(part.snr_db))
    bound = np.empty((*shape, 3))
    error = np.full((len(METHODS), *shape, runs, 3), np.nan)
    truth_weight = np.zeros((*shape, runs))
    for s, snr_db in enumerate(part.snr_db):
        t_s, model = _times(part), _model(part, snr_db)
        for c, count in enumerate(COUNTS):
            C = pass_bound(THETA, LAYOUT_KM[:count], t_s, models=model).covariance
            v = np.diag(C)
            bound[c, s] = np.sqrt([v[0], v[1] + v[2], v[3] + v[4]])
        for r in range(runs):
            heard = _hear(t_s, model, THETA, rng)
            for c, count in enumerate(COUNTS):
                limit = OUTLIER * float(bound[c, s, 1])
                found, weight = _estimates(heard, count, limit)
                error[:, c, s, r] = np.abs(found)
                truth_weight[c, s, r] = weight
        tick()
    return FusionErrors(bound, error, truth_weight)


def _estimates(heard: _Heard, count: int, limit: float) -> tuple[Matrix, float]:
    """Errors (methods, 3) of P, x0, v, and the weight of what is near the truth."""
    ours = fuse(_messages(heard, heard.profiles[:count]))
    told = _messages(heard, heard.printed[:count])
    printed = fuse_as_printed(told, fishers(told))
    raw = _raw(heard, count)
    rows = [_off(ours.theta[:1]), _nearest(ours), _off(printed.theta[:1])]
    for start in (ours, printed):
        ends = (
            fits(raw, start.theta[:1])
            if len(start.theta) and np.isfinite(start.theta[0]).all()
            else ()
        )
        rows.append(_off(np.array([end.theta for end in ends]).reshape(-1, 5)))
    near = [float(_off(theta[None])[1]) < limit for theta in ours.theta]
    return np.array(rows), float(ours.weight[near].sum()) if len(near) else 0.0


def _off(theta: Matrix) -> Vector:
    """Errors (3,) of P, x0, v; nothing found is infinitely wrong."""
    if not len(theta):
        return np.full(3, np.inf)
    e = theta[0] - THETA
    return np.array([abs(e[0]), np.hypot(e[1], e[2]), np.hypot(e[3], e[4])])


def _nearest(found: Passes) -> Vector:
    """Errors of the best of all trajectories that came back."""
    errors = [_off(theta[None]) for theta in found.theta]
    return min(errors, key=lambda e: float(e[1]), default=np.full(3, np.inf))


def _hear(t_s: Vector, model: AmplitudeModel, theta: Vector, rng: np.random.Generator) -> _Heard:
    mean = expected(predict(theta, LAYOUT_KM), t_s)
    values = amplitude.noisy(model, mean, rng=rng)
    ours, printed = fit(model, t_s, values), fit(model, t_s, values, starts="paper")
    return _Heard(t_s, model, values, ours.profile.array(), printed.profile.array())


def _messages(heard: _Heard, profiles: Matrix) -> PassMessages:
    count = len(profiles)
    records = common_records(count, heard.t_s)
    return PassMessages(LAYOUT_KM[:count], (heard.model,) * count, profiles, records)


def _raw(heard: _Heard, count: int) -> RawPass:
    m = heard.t_s.size
    return RawPass(
        LAYOUT_KM[:count],
        (heard.model,) * count,
        np.repeat(np.arange(count, dtype=np.int32), m),
        np.tile(heard.t_s, count),
        heard.values[:count].ravel(),
    )


def _grouping(runs: int, rng: np.random.Generator) -> tuple[GroupingScore, ...]:
    """Messages of one to three targets at once, without names: how often all are found."""
    t_s = np.arange(RECORD_S + 1.0)
    targets = np.vstack([THETA, OTHERS])
    scores: list[GroupingScore] = []
    for snr_db in (10.0, 20.0, 30.0):
        model = AmplitudeModel(sigma=10.0 ** (-snr_db / 20.0))
        for count in (1, 2, 3):
            right = 0
            for _ in range(runs):
                told = np.concatenate(
                    [_hear(t_s, model, one, rng).profiles for one in targets[:count]]
                )
                order = rng.permutation(len(told))
                sensor = np.tile(np.arange(20, dtype=np.int32), count)[order]
                records = common_records(len(told), t_s)
                given = PassMessages(LAYOUT_KM[sensor], (model,) * len(told), told[order], records)
                found = group(given, sensor).groups
                hit = {_which(one.passes.theta[0], targets[:count]) for one in found}
                right += len(found) == count and hit == set(range(count))
            scores.append(GroupingScore(snr_db, count, right, runs))
    return tuple(scores)


def _which(theta: Vector, targets: Matrix) -> int:
    """Which target a trajectory is, by where it is in the middle of the record; -1: of none."""
    half = RECORD_S / 2.0
    there = targets[:, 1:3] + half * targets[:, 3:5]
    apart = np.linalg.norm(theta[1:3] + half * theta[3:5] - there, axis=1)
    return int(np.argmin(apart)) if apart.min() < 0.15 else -1


def _times(part: FusionPart) -> Vector:
    return np.arange(int(RECORD_S * part.rate_hz) + 1) / part.rate_hz


def _model(part: FusionPart, snr_db: float) -> AmplitudeModel:
    return AmplitudeModel(sigma=10.0 ** (-snr_db / 20.0), fading=part.fading)
