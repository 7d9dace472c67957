"""One scan of 19 ranges: trackfield's tracker against Stone Soup's EKF and a plain NumPy EKF.

A target drives past 19 sensors in range; all see the same readings, interleaved in one process,
and estimate four states (constant velocity, no IMM). Times are of the processor, the least of 40
blocks of 100 scans, so that a busy machine does not matter.
"""

from __future__ import annotations

import datetime
import sys
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from trackfield.network.site import Site, Target, TrackerSettings
from trackfield.pipeline.tagged import Tracker
from trackfield.sensing.range import RangeModel
from trackfield.types import Matrix, Vector

Position = Vector | tuple[float, ...]
Step = Callable[[int], Position | None]

DT_S, SCANS, SENSORS, BLOCK = 0.1, 4000, 19, 100
ACCEL_SIGMA = 0.05
MODEL = RangeModel(sigma_m=1e-3**0.5, sigma_scale=1e-3**0.5)


class Drive(NamedTuple):
    """True positions (K, 2), sensors (n, 2), readings (K, n)."""

    path: Matrix
    sensors: Matrix
    ranges: Matrix


def drive(seed: int = 0) -> Drive:
    """Drive a slow loop among 19 sensors, with noise of both kinds."""
    rng = np.random.default_rng(seed)
    sensors = rng.uniform(-2.0, 2.0, (SENSORS, 2))
    way = np.arange(SCANS) * DT_S * 0.3
    path = np.stack([np.sin(way), np.cos(0.7 * way)], axis=1)
    r = np.linalg.norm(path[:, None] - sensors, axis=2)
    noise = rng.standard_normal((2, *r.shape))
    return Drive(path, sensors, r * (1 + MODEL.sigma_scale * noise[0]) + MODEL.sigma_m * noise[1])


def ours(given: Drive) -> Step:
    """Make the default tracker without IMM; a scan a call."""
    n = len(given.sensors)
    site = Site(
        "scan",
        tuple(str(i) for i in range(n)),
        np.column_stack([given.sensors, np.full(n, np.nan)]),
        (MODEL,) * n,
        Target(motion="cv", accel_sigma_m_s2=ACCEL_SIGMA),
        TrackerSettings(window_s=0.0),
    )
    tracker = Tracker(site)
    sensor = np.arange(n, dtype=np.int32)

    def step(k: int) -> Position | None:
        fix = tracker.step(k * DT_S, sensor, value=given.ranges[k], target_id="car")
        return None if fix is None else (fix.x_m, fix.y_m)

    return step


def numpy_ekf(given: Drive) -> Step:
    """EKF in information form, vectorised over the sensors: what a script would do."""
    F = np.eye(4)
    F[0, 2] = F[1, 3] = DT_S
    G = np.array([[DT_S**2 / 2, 0], [0, DT_S**2 / 2], [DT_S, 0], [0, DT_S]])
    Q = ACCEL_SIGMA**2 / DT_S * G @ G.T
    state = {"x": np.array([*given.path[0], 0.3, 0.0]), "P": 0.01 * np.eye(4)}

    def step(k: int) -> Position:
        z = given.ranges[k]
        R = MODEL.sigma_m**2 + MODEL.sigma_scale**2 * z**2
        x, P = F @ state["x"], F @ state["P"] @ F.T + Q
        offset = x[:2] - given.sensors
        r = np.sqrt((offset**2).sum(1))
        H = np.zeros((len(r), 4))
        H[:, :2] = offset / r[:, None]
        weighted = H.T / R
        P = np.linalg.inv(np.linalg.inv(P) + weighted @ H)
        x = x + P @ (weighted @ (z - r))
        state.update(x=x, P=P)
        return x[:2]

    return step


def stonesoup_ekf(given: Drive) -> Step:
    """Stone Soup's EKF with the analytic Jacobian and all ranges stacked."""
    from stonesoup.base import Property
    from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
    from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.types.array import StateVector
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import GaussianState
    from stonesoup.updater.kalman import ExtendedKalmanUpdater

    class Ranges(NonLinearGaussianMeasurement):
        """Ranges to fixed sensors, stacked."""

        sensors: np.ndarray = Property()

        @property
        def ndim_meas(self) -> int:
            return len(self.sensors)

        def function(self, state, noise=False, **_):  # noqa: ANN001, ANN003, ANN202 - its contract
            offset = np.asarray(state.state_vector[:2, 0], float) - self.sensors
            return StateVector(np.sqrt((offset**2).sum(1)))

        def jacobian(self, state, **_):  # noqa: ANN001, ANN003, ANN202 - its contract
            offset = np.asarray(state.state_vector[:2, 0], float) - self.sensors
            H = np.zeros((len(offset), 4))
            H[:, :2] = offset / np.sqrt((offset**2).sum(1))[:, None]
            return H

    F = np.eye(4)
    F[0, 2] = F[1, 3] = DT_S
    G = np.array([[DT_S**2 / 2, 0], [0, DT_S**2 / 2], [DT_S, 0], [0, DT_S]])
    predictor = KalmanPredictor(
        LinearGaussianTimeInvariantTransitionModel(
            transition_matrix=F, covariance_matrix=ACCEL_SIGMA**2 / DT_S * G @ G.T
        )
    )
    updater = ExtendedKalmanUpdater(None)
    start = datetime.datetime(2024, 1, 1, tzinfo=datetime.UTC)
    first = GaussianState(np.array([[*given.path[0], 0.3, 0.0]]).T, 0.01 * np.eye(4), start)
    state = {"x": first}

    def step(k: int) -> Position:
        z = given.ranges[k]
        R = MODEL.sigma_m**2 + MODEL.sigma_scale**2 * z**2
        now = start + datetime.timedelta(seconds=DT_S * (k + 1))
        model = Ranges(4, (0, 1), np.diag(R), sensors=given.sensors)
        prior = predictor.predict(state["x"], timestamp=now)
        detection = Detection(z.reshape(-1, 1), timestamp=now, measurement_model=model)
        state["x"] = updater.update(SingleHypothesis(prior, detection))
        return np.asarray(state["x"].mean, float).ravel()[:2]

    return step


def compare(steps: dict[str, Step], given: Drive) -> dict[str, tuple[float, float]]:
    """Least processor time per scan [s] and RMSE [m] of each, interleaved in blocks."""
    times: dict[str, list[float]] = {name: [] for name in steps}
    errors: dict[str, list[float]] = {name: [] for name in steps}
    for block in range(0, SCANS, BLOCK):
        for name, step in steps.items():
            before = time.process_time()
            found = [step(k) for k in range(block, block + BLOCK)]
            times[name].append((time.process_time() - before) / BLOCK)
            for k, position in zip(range(block, block + BLOCK), found, strict=True):
                if position is not None and k >= BLOCK:
                    errors[name].append(float(((np.array(position) - given.path[k]) ** 2).sum()))
    return {name: (min(times[name][1:]), float(np.sqrt(np.mean(errors[name])))) for name in steps}


def main() -> None:
    """Print times and ratios."""
    given = drive()
    steps = {"trackfield": ours(given), "NumPy EKF": numpy_ekf(given)}
    try:
        steps["Stone Soup EKF"] = stonesoup_ekf(given)
    except ModuleNotFoundError:
        print("Stone Soup is not installed (make bench installs it)", file=sys.stderr)
    found = compare(steps, given)
    mine = found["trackfield"][0]
    for name, (seconds, rmse) in found.items():
        print(
            f"{name:16s} {seconds * 1e6:8.1f} us a scan {seconds / mine:8.1f} x   RMSE {rmse:.4f} m"
        )


if __name__ == "__main__":
    main()
