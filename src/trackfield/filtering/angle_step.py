"""One step of a track from bearings, angular rates and motion: moved, then conditioned on a scan.

The arithmetic is compiled (`trackfield._core`): an interacting multiple model of white acceleration
whose modes take iterated updates, as `interacting` and `extended.iterate` do. Readings are a
mixture of usual ones and outliers, and count with their mean precision (EM), which costs next to
nothing where there are no outliers. Outliers in every reading at once are an unlikely excuse, so
each mode's likelihood pays for what it sets aside. Motion in the plane has a sign that its sensor
does not tell: the prediction tells it together with the bearings and rates of the scan, as far as
they can. And a sensor with a threshold says something by its silence: |rate| < threshold, unless it
is broken.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trackfield._core import _angles
from trackfield.filtering.angle_readings import AngleSensors
from trackfield.filtering.angle_state import AngleTrack
from trackfield.filtering.interacting import Modes
from trackfield.types import Gaussian, Matrix, Vector

KINDS = ((0.95, 0.0), (0.04, 5.0), (0.01, 30.0))
"""Kinds of readings: share, and deviation beside the noise [sigma]. The first is the usual one."""
STEPS, HALVINGS, TOLERANCE = 6, 4, 1e-3  # of an iterated update
JUDGED = 8  # scans by which a track is judged lost
WEIGHED = 16  # scans by which another answer is weighed against a track
MISFIT = 9.0  # squared innovation per reading that counts as one

_KINDS = np.array(KINDS)
_ITERATION = np.array([STEPS, HALVINGS, TOLERANCE])


class AngleMotions(NamedTuple):
    """Ways to move: white acceleration of `densities` (M,) [m^2/s^3], left after `stays_s` (M,)."""

    densities: tuple[float, ...]
    stays_s: tuple[float, ...]


class HeardAngles(NamedTuple):
    """A scan: what `sensors` read, `value` (m,), or that they said nothing.

    `alive` (m,) is NaN of a sensor that spoke; of one that kept silent it is the chance that it
    works, and its value does not count.
    """

    sensors: AngleSensors
    value: Vector
    alive: Vector


class Advanced(NamedTuple):
    """A track after a scan; `silence` (m,): the chance of each one's silence, if it works."""

    track: AngleTrack
    silence: Vector


def spoken(sensors: AngleSensors, value: Vector) -> HeardAngles:
    """Make a scan of readings, all of which were made."""
    return HeardAngles(sensors, value, np.full(value.shape, np.nan))


def advance(
    track: AngleTrack, heard: HeardAngles, *, t_s: float, motions: AngleMotions
) -> Advanced:
    """Carry a track to `t_s` and condition all its hypotheses on a scan; their weights too.

    Sensors may have moved since the last scan: `heard.sensors` has their places and velocities of
    now. Hypotheses are not thinned, and `confirmed` is as it was.
    """
    modes = track.modes
    *tables, log_likelihood, nis, silence = _angles.step(
        modes.weights,
        modes.beliefs.mean,
        modes.beliefs.covariance,
        t_s - track.t_s,
        np.array(motions).T.copy(),
        _KINDS,
        _ITERATION,
        _table(heard.sensors),
        np.ascontiguousarray(heard.value, float),
        np.ascontiguousarray(heard.alive, float),
    )
    shares, mean, covariance, prior_mean, prior_covariance, whole_mean, whole_covariance = tables
    weights = _weighed(track.weights, log_likelihood)
    best = int(weights.argmax())
    misfits = track.misfits
    if np.isfinite(nis[best]):
        misfits = (*misfits, bool(nis[best] > MISFIT))[-JUDGED:]
    evidence = np.column_stack([track.evidence, log_likelihood])[:, -WEIGHED:]
    advanced = AngleTrack(
        t_s=t_s,
        names=track.names,
        weights=weights,
        modes=Modes(shares, Gaussian(mean, covariance)),
        prior=Gaussian(prior_mean, prior_covariance),
        whole=Gaussian(whole_mean, whole_covariance),
        nis=float(nis[best]),
        misfits=misfits,
        evidence=evidence,
        confirmed=track.confirmed,
    )
    return Advanced(advanced, silence[best])


def _weighed(weights: Vector, log_likelihood: Vector) -> Vector:
    log_weight = np.log(weights) + log_likelihood
    found: Vector = np.exp(log_weight - log_weight.max())
    return found / found.sum()


def _table(sensors: AngleSensors) -> Matrix:
    """Table of sensors as the kernel reads it, one row a sensor."""
    table = np.empty((sensors.says.size, 12))
    table[:, 0] = sensors.says
    table[:, 1:4] = sensors.place
    table[:, 4:7] = sensors.velocity
    for k, column in enumerate(sensors[3:]):
        table[:, 7 + k] = column
    return table
