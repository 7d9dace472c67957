"""A Kalman filter of sensors that say one coordinate each, and runs of such readings."""

import struct
from typing import NamedTuple

import numpy as np

from trackfield.errors import StateError
from trackfield.filtering.scans import Scan, Shown
from trackfield.network.site import Site, Target, TrackerSettings
from trackfield.sensing.bearing import BearingModel
from trackfield.types import Readings, Status

SIGMA, DENSITY, LOST = 0.1, 0.3, 30.0
UNKNOWN = np.diag([100.0, 100.0, 1.0, 1.0])


class Belief(NamedTuple):
    """Mean and covariance of x, y, vx, vy at a time, who was heard, and whether it is lost."""

    t_s: float = 0.0
    mean: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    covariance: tuple[float, ...] = tuple(UNKNOWN.ravel())
    heard: int = 0  # bit 0: x, bit 1: y
    nis: float = 0.0
    lost: bool = False


class PlainFilter:
    """Sensors of even number say x, those of odd number y; a reading far off ends the track."""

    def start(self) -> Belief:
        return Belief()

    def step(self, state: Belief, scan: Scan) -> Belief:
        if state.lost:
            state = Belief()
        mean, P = _moved(state, scan.t_s)
        heard, worst = state.heard, 0.0
        for sensor, value, sigma in zip(scan.sensor, scan.value, scan.sigma, strict=True):
            axis = int(sensor) % 2
            heard |= 1 << axis
            R = (SIGMA if np.isnan(sigma) else sigma) ** 2
            S = P[axis, axis] + R
            K = P[:, axis] / S
            worst = max(worst, (value - mean[axis]) ** 2 / S)
            mean = mean + K * (value - mean[axis])
            P = P - np.outer(K, P[axis])
        lost = bool(state.heard == 3 and worst > LOST)
        return Belief(scan.t_s, tuple(mean), tuple(P.ravel()), heard, worst, lost)

    def shown(self, state: Belief, t_s: float) -> Shown | None:
        if state.heard != 3:
            return None
        mean, P = _moved(state, t_s)
        status = Status.CONFIRMED if t_s == state.t_s else Status.COASTING
        nis = state.nis if t_s == state.t_s else np.nan
        return _told(t_s, mean, P, status=Status.ENDED if state.lost else status, nis=nis)

    def hindsight(self, states) -> Shown | None:
        """Rauch, Tung, Striebel."""
        mean, P = np.array(states[-1].mean), _matrix(states[-1])
        for state in reversed(states[:-1]):
            after = states[states.index(state) + 1].t_s
            ahead, A = _moved(state, after)
            G = _matrix(state) @ _transition(after - state.t_s).T @ np.linalg.inv(A)
            mean = np.array(state.mean) + G @ (mean - ahead)
            P = _matrix(state) + G @ (P - A) @ G.T
        if states[0].heard != 3:
            return None
        return _told(states[0].t_s, mean, P, status=Status.CONFIRMED, nis=states[0].nis)

    def pack(self, state: Belief) -> bytes:
        return struct.pack(
            "<22d2B", state.t_s, *state.mean, *state.covariance, state.nis, state.heard, state.lost
        )

    def unpack(self, data: bytes) -> Belief:
        if len(data) != struct.calcsize("<22d2B"):
            raise StateError("found no belief")
        *numbers, heard, lost = struct.unpack("<22d2B", data)
        return Belief(
            numbers[0], tuple(numbers[1:5]), tuple(numbers[5:21]), heard, numbers[21], bool(lost)
        )


def _matrix(state: Belief):
    return np.reshape(state.covariance, (4, 4))


def _transition(dt):
    F = np.eye(4)
    F[0, 2] = F[1, 3] = dt
    return F


def _moved(state: Belief, t_s: float):
    dt = t_s - state.t_s if state.heard else 0.0
    F = _transition(dt)
    axis = np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    Q = DENSITY * np.kron(axis, np.eye(2))
    return F @ np.array(state.mean), F @ _matrix(state) @ F.T + Q


def _told(t_s, mean, P, *, status, nis):
    position, velocity = np.append(mean[:2], np.nan), np.append(mean[2:], np.nan)
    return Shown(t_s, position, velocity, P[[0, 0, 1], [0, 1, 1]], status, float(nis))


def plain_site(*, window_s=1.0, drop_s=5.0, sensors=4) -> Site:
    return Site(
        name="axes",
        sensor_ids=tuple(f"s{i}" for i in range(sensors)),
        positions=np.column_stack(
            [np.arange(float(sensors)), np.zeros(sensors), np.full(sensors, np.nan)]
        ),
        models=(BearingModel(),) * sensors,
        target=Target(),
        tracker=TrackerSettings(window_s=window_s, drop_s=drop_s),
    )


class Heard(NamedTuple):
    t: float
    sensor: int
    value: float
    target: str | None = None
    sigma: float = np.nan


def plain_table(site: Site, rows, *, arrival=None) -> Readings:
    rows = list(rows)
    names = tuple(dict.fromkeys(z.target for z in rows if z.target is not None))
    return Readings(
        t_s=np.array([z.t for z in rows], float),
        sensor=np.array([z.sensor for z in rows], np.int32),
        value=np.array([z.value for z in rows], float),
        target=np.array(
            [-1 if z.target is None else names.index(z.target) for z in rows], np.int32
        ),
        kind=np.zeros(len(rows), np.int32),
        sigma=np.array([z.sigma for z in rows], float),
        arrival_s=np.full(len(rows), np.nan) if arrival is None else np.array(arrival, float),
        sensor_ids=site.sensor_ids,
        target_ids=names,
        kinds=("bearing",),
    )


def plain_run(rng, times, *, target=None, phase=0.0, sensors=4) -> list[Heard]:
    """One to all sensors at each time, of a target on a slow curve."""
    rows = []
    for t in times:
        x = np.array([2.0 * np.sin(0.3 * t + phase), 1.5 * np.cos(0.2 * t + phase)])
        chosen = rng.permutation(sensors)[: int(rng.integers(1, sensors + 1))]
        rows += [
            Heard(float(t), int(i), float(x[i % 2] + SIGMA * rng.standard_normal()), target)
            for i in chosen
        ]
    return rows
