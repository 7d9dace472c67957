"""The filters that Wang's comparison is about, run side by side on the same readings."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from trackfield.experiments.results import Interval
from trackfield.filtering import converted, extended, kalman, pcrb
from trackfield.filtering.converted import Mode
from trackfield.filtering.extended import Ranges, Weigh
from trackfield.filtering.matrices import solve
from trackfield.localization.range_likelihood import RangeScan
from trackfield.motion import Motion
from trackfield.sensing.range import RangeModel
from trackfield.simulation.roads import Drive
from trackfield.types import Gaussian, Matrix, Vector

PICKS = 1000  # resamples of a bootstrap
NEAREST = 3  # sensors that the "three sensors" filter listens to


class Race(NamedTuple):
    """One drive with its readings: all that a filter is given.

    `ranges` (runs, K, n), NaN where not made; `start` means (runs, 4), covariance (4, 4).
    """

    drive: Drive
    ranges: Matrix
    start: Gaussian
    motion: Motion
    model: RangeModel
    dt_s: float


class Followed(NamedTuple):
    """Where a filter saw the target: `position` (K, runs, 2), and its squared state errors.

    `nees` (K, runs) are error' P^-1 error of the whole state; `prelocalized` (K, runs, 2) are the
    positions that entered a converted filter, before it.
    """

    position: Matrix
    nees: Matrix
    prelocalized: Matrix | None = None


class Seen(NamedTuple):
    """What a rule says after a scan."""

    belief: Gaussian
    prelocalized: Matrix | None = None


Rule = Callable[[Gaussian, Matrix, Matrix, RangeModel], Seen]
"""Prior of the runs, ranges (runs, m), sensors (m, 2), model -> what is believed then."""


def kf_mle(mode: Mode) -> Rule:
    """Build the paper's filter: maximum likelihood positions into a Kalman filter."""

    def rule(prior: Gaussian, z: Matrix, sensors: Matrix, model: RangeModel) -> Seen:
        start = prior.mean[:, :2]
        found = converted.prelocalize(RangeScan(sensors, z, model), start, mode=mode)
        shown = np.where(found.ok[:, None], found.position, start)
        return Seen(converted.update(prior, found).posterior, shown)

    return rule


def ekf(prior: Gaussian, z: Matrix, sensors: Matrix, model: RangeModel) -> Seen:
    """Apply the extended filter, noise sigma_n^2 + sigma_gamma^2 z^2, Wang 4.2."""
    return Seen(extended.update(prior, z, Ranges(sensors, model)).posterior)


def ekf_additive(prior: Gaussian, z: Matrix, sensors: Matrix, model: RangeModel) -> Seen:
    """Apply an extended filter that was not told of the multiplicative noise."""
    return ekf(prior, z, sensors, RangeModel(model.bias_m, model.scale, model.sigma_m))


def ekf_three(prior: Gaussian, z: Matrix, sensors: Matrix, model: RangeModel) -> Seen:
    """Apply an extended filter that hears the nearest three sensors only."""
    order = np.argsort(np.argsort(np.where(np.isnan(z), np.inf, z), axis=1), axis=1)
    return ekf(prior, np.where(order < NEAREST, z, np.nan), sensors, model)


def iekf(weigh: Weigh | None = None) -> Rule:
    """Build the iterated extended filter, with robust weights if given."""

    def rule(prior: Gaussian, z: Matrix, sensors: Matrix, model: RangeModel) -> Seen:
        found = extended.iterate(prior, z, Ranges(sensors, model), weigh=weigh)
        return Seen(found.update.posterior)

    return rule


def follow(rule: Rule, race: Race) -> Followed:
    """Run a filter over all runs of a race at once."""
    runs, steps, _ = race.ranges.shape
    F, Q = race.motion.transition(race.dt_s), race.motion.noise(race.dt_s)
    belief = Gaussian(race.start.mean, np.broadcast_to(race.start.covariance, (runs, 4, 4)))
    positions, nees = np.empty((steps, runs, 2)), np.empty((steps, runs))
    fixes: list[Matrix] = []
    for k in range(steps):
        heard = np.flatnonzero(~np.isnan(race.ranges[:, k]).all(axis=0))
        prior = kalman.predict(belief, F, Q)
        belief, fix = rule(prior, race.ranges[:, k, heard], race.drive.sensors[heard], race.model)
        positions[k] = belief.mean[:, :2]
        error = belief.mean - race.drive.truth[k]
        nees[k] = (error * solve(belief.covariance, error)).sum(-1)
        if fix is not None:
            fixes.append(fix)
    return Followed(positions, nees, np.array(fixes) if fixes else None)


def bound(race: Race) -> Vector:
    """Least RMSE per axis (K,) [m] that the model allows: the posterior Cramer-Rao bound."""
    information = pcrb.range_information(race.drive.sensors, race.drive.truth, models=race.model)
    bounds = pcrb.recursion(
        race.start.covariance, race.motion, dt_s=race.dt_s, information=information
    )
    return np.sqrt((bounds[:, 0, 0] + bounds[:, 1, 1]) / 2)


def squares(position: Matrix, drive: Drive) -> Matrix:
    """Mean square error per axis (K, runs) [m^2] of positions (K, runs, 2)."""
    return ((position - drive.truth[:, None, :2]) ** 2).mean(axis=-1)


def picks(rng: np.random.Generator, runs: int) -> Matrix:
    """Draw the resamples of a paired bootstrap over runs, as weights (PICKS, runs)."""
    return rng.multinomial(runs, np.full(runs, 1.0 / runs), size=PICKS) / runs


def rmse(square: Vector, resamples: Matrix) -> Interval:
    """Root mean square of runs with mean squares (runs,)."""
    return _interval(math.sqrt(square.mean()), np.sqrt(resamples @ square))


def gain(ours: Vector, theirs: Vector, resamples: Matrix) -> Interval:
    """By how many percent our RMSE is below theirs, paired run by run."""
    value = 100.0 * (1.0 - math.sqrt(ours.mean() / theirs.mean()))
    drawn = 100.0 * (1.0 - np.sqrt((resamples @ ours) / (resamples @ theirs)))
    return _interval(value, drawn)


def _interval(value: float, drawn: Vector) -> Interval:
    low, high = np.quantile(drawn, [0.025, 0.975])
    return Interval(value, float(low), float(high))
