"""The compiled filter of binary fields agrees with its plain twin, to rounding."""

from __future__ import annotations

import numpy as np
import pytest

from detect_twin import Chance, DetectTwin
from trackfield.association import detect as detect_module
from trackfield.association.detect import Detect, DetectSettings, ReadingScan
from trackfield.association.detect_field import DetectField
from trackfield.sensing.detection import DetectionModel, simulate

SENSORS = np.array([(6.0 * j, 6.0 * i) for i in range(5) for j in range(5)])
MODEL = DetectionModel(edge_m=1.0)


def crossing(says_zero, steps=28):
    """Three walkers that meet in the middle of a small field; values (steps, n)."""
    rng = np.random.default_rng(4)
    t = np.arange(steps)[:, None]
    paths = np.stack(
        [
            np.hstack([-1.0 + 1.2 * t, 11.0 + 0.1 * t]),
            np.hstack([12.0 + 0.1 * t, 25.0 - 1.1 * t]),
            np.where(t >= 8, np.hstack([25.0 - 1.2 * (t - 8), 24.0 - 0.5 * t]), np.nan),
        ],
        axis=1,
    )
    alive = np.arange(25) != 7
    said = simulate(MODEL, SENSORS, paths=paths, rng=rng, delivery=0.9, alive=alive)
    values = np.where(said.received, 1, -1).astype(np.int8)
    if says_zero:
        heard = alive & (rng.random(values.shape) < 0.9)
        values = np.where(heard, said.detected, -1).astype(np.int8)
    values[20:23, SENSORS[:, 0] > 13.0] = -1  # their leader is down
    values[25] = 1  # a burst
    return values


@pytest.mark.parametrize("says_zero", [False, True])
@pytest.mark.parametrize("step_s", [1.0, 0.5])
def test_the_kernel_agrees_with_its_twin(says_zero, step_s):
    group = (SENSORS[:, 0] > 13.0).astype(np.int32)
    field = DetectField(
        SENSORS, MODEL, delivery=0.9, says_zero=says_zero, step_s=step_s, group=group
    )
    settings = DetectSettings(particles=240, turns_per_s=0.1, births_per_s=0.1)
    tracker = Detect(field, settings)
    numbers = detect_module._numbers(field, settings, tracker.coverage, 8.12)
    grid, start, sensor, covered = tracker.coverage
    dense = np.zeros((grid[3] * grid[4], len(SENSORS)))
    dense[np.repeat(np.arange(len(dense)), np.diff(start)), sensor] = covered
    sensors = np.tile([MODEL.p_detection, MODEL.p_false, 0.9, 0.0], (len(SENSORS), 1))
    sensors[:, 3] = group
    twin = DetectTwin(numbers, grid, dense, sensors, seed=5)
    state, largest, most = tracker.initial(5), 0, 0
    for k, value in enumerate(crossing(says_zero)):
        state, info = tracker.step(state, ReadingScan((k + 1) * step_s, value))
        twin.step(value, step_s)
        estimates = tracker.estimates(state)
        members = sorted((m for g in twin.groups for m in g.members), key=lambda m: m.track)
        assert estimates.track.tolist() == [m.track for m in members]
        existence = [m.existence for m in members]
        np.testing.assert_allclose(estimates.existence, existence, rtol=1e-7, atol=1e-10)
        means = np.array([m.mean for m in members]).reshape(-1, 4)
        np.testing.assert_allclose(estimates.mean, means, rtol=1e-7, atol=1e-7)
        dead, stuck = tracker.nodes(state)
        np.testing.assert_allclose(dead, twin.dead, rtol=1e-7, atol=1e-12)
        np.testing.assert_allclose(stuck, twin.stuck, rtol=1e-7, atol=1e-12)
        largest = max(largest, info.counts["largest_group"])
        most = max(most, int(estimates.shown.sum()))
    assert largest >= 3  # of a run in which nothing meets this would say little
    assert most >= 2


def test_chance_is_even_and_nearly_normal():
    chance = Chance(1)
    u, z = chance.uniform(np.arange(200_000)), chance.normal(np.arange(200_000))
    assert abs(np.histogram(u, 50, (0.0, 1.0))[0] / 4000.0 - 1.0).max() < 0.07
    assert abs(z.mean()) < 0.01
    assert abs(z.std() - 1.0) < 0.01
    assert abs((z**4).mean() - 2.7) < 0.05  # a sum of four uniforms
