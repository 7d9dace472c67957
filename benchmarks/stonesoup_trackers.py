"""Stone Soup's trackers of many targets, as steps from a scan to the tracks that they show.

GNN and JPDA (EHM2), with parameters that were best on seeds 100 to 102 of the scenario: three
reports to begin, gate of three sigmas, the end after three steps without a report (GNN) or when
the position's variance passes 2 m^2 (JPDA).
"""

from __future__ import annotations

import datetime
from collections.abc import Callable
from typing import Any

import numpy as np
from report_scenario import (
    ACCEL_SIGMA,
    FALSE_PER_SCAN,
    P_DETECTION,
    SIDE_M,
    SIGMA_M,
)
from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
from stonesoup.dataassociator.probability import JPDAwithEHM2
from stonesoup.deleter.error import CovarianceBasedDeleter
from stonesoup.deleter.time import UpdateTimeStepsDeleter
from stonesoup.functions import gm_reduce_single
from stonesoup.hypothesiser.distance import DistanceHypothesiser
from stonesoup.hypothesiser.probability import PDAHypothesiser
from stonesoup.initiator.simple import MultiMeasurementInitiator
from stonesoup.measures import Mahalanobis
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.types.array import StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.state import GaussianState
from stonesoup.types.update import GaussianStateUpdate
from stonesoup.updater.kalman import KalmanUpdater

from trackfield.association.contract import ReportScan
from trackfield.types import Matrix

Step = Callable[[ReportScan], Matrix]  # to rows (n, 3) of track, x, y
START = datetime.datetime(2024, 1, 1, tzinfo=datetime.UTC)
GATE, BEGIN_REPORTS, BEGIN_MISSES, MISSES, MOST_VARIANCE, P_GATE = 3.0, 3, 2, 3, 2.0, 0.99


def gnn() -> Step:
    """Make a tracker by global nearest neighbours."""
    predictor, updater, initiator = _parts()
    near = DistanceHypothesiser(predictor, updater, Mahalanobis(), missed_distance=GATE)
    associator, deleter = GNNWith2DAssignment(near), UpdateTimeStepsDeleter(MISSES)
    tracks, numbers = set(), {}

    def step(scan: ReportScan) -> Matrix:
        now, free = _detections(scan)
        for track, found in associator.associate(tracks, free, now).items():
            if found:
                track.append(updater.update(found))
                free.discard(found.measurement)
            else:
                track.append(found.prediction)
        tracks.difference_update(deleter.delete_tracks(tracks, timestamp=now))
        tracks.update(initiator.initiate(free, now))
        return _rows(tracks, numbers)

    return step


def jpda() -> Step:
    """Make a tracker by joint probabilistic data association."""
    predictor, updater, initiator = _parts()
    likely = PDAHypothesiser(
        predictor,
        updater,
        clutter_spatial_density=FALSE_PER_SCAN / SIDE_M**2,
        prob_detect=P_DETECTION,
        prob_gate=P_GATE,
    )
    associator = JPDAwithEHM2(likely)
    deleter = CovarianceBasedDeleter(MOST_VARIANCE, mapping=[0, 1])
    tracks, numbers = set(), {}

    def step(scan: ReportScan) -> Matrix:
        now, free = _detections(scan)
        for track, several in associator.associate(tracks, free, now).items():
            states = [updater.update(one) if one else one.prediction for one in several]
            mean, covariance = gm_reduce_single(
                StateVectors([state.state_vector for state in states]),
                np.stack([state.covar for state in states], axis=2),
                np.asarray([one.probability for one in several]),
            )
            track.append(GaussianStateUpdate(mean, covariance, several, now))
            free.difference_update(one.measurement for one in several if one)
        tracks.difference_update(deleter.delete_tracks(tracks))
        tracks.update(initiator.initiate(free, now))
        return _rows(tracks, numbers)

    return step


def _parts() -> tuple[KalmanPredictor, KalmanUpdater, MultiMeasurementInitiator]:
    F = np.eye(4)
    F[0, 2] = F[1, 3] = 1.0
    G = np.array([[0.5, 0], [0, 0.5], [1.0, 0], [0, 1.0]])
    noise = ACCEL_SIGMA**2 * G @ G.T + 1e-9 * np.eye(4)
    motion = LinearGaussianTimeInvariantTransitionModel(
        transition_matrix=F, covariance_matrix=noise
    )
    model = LinearGaussian(4, (0, 1), SIGMA_M**2 * np.eye(2))
    predictor, updater = KalmanPredictor(motion), KalmanUpdater(model)
    near = DistanceHypothesiser(predictor, updater, Mahalanobis(), missed_distance=GATE)
    initiator = MultiMeasurementInitiator(
        GaussianState(np.zeros((4, 1)), np.diag([0, 0, 1.0, 1.0]), timestamp=START),
        UpdateTimeStepsDeleter(BEGIN_MISSES),
        GNNWith2DAssignment(near),
        updater,
        model,
        min_points=BEGIN_REPORTS,
    )
    return predictor, updater, initiator


def _detections(scan: ReportScan) -> tuple[datetime.datetime, set[Detection]]:
    now = START + datetime.timedelta(seconds=scan.t_s)
    return now, {Detection(z.reshape(2, 1), timestamp=now) for z in scan.position}


def _rows(tracks: set[Any], numbers: dict[str, int]) -> Matrix:
    rows = [
        (numbers.setdefault(track.id, len(numbers) + 1), *np.ravel(track.state_vector)[:2])
        for track in tracks
    ]
    return np.array(rows, float).reshape(-1, 3)
