"""The paper's observer: exact on exact readings, and unable to mend its start."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from angle_runs import CORNERS, round_trip, straight
from trackfield.errors import InputError
from trackfield.filtering import angle_observer
from trackfield.sensing import angular_rate
from trackfield.sensing.angular_rate import AngularRateModel

DT = 0.05


def rates(path, sensors=CORNERS):
    return angular_rate.expected(AngularRateModel(), sensors, states=path)


@pytest.mark.parametrize("path", [straight(80, DT), round_trip(80, DT)], ids=["straight", "round"])
def test_exact_readings_and_an_exact_start_give_the_path(path):
    given = angle_observer.record(DT * np.arange(80), rates(path), CORNERS)
    found = angle_observer.observe(given, path[0, :2])
    np.testing.assert_allclose(found.position, path[:, :2], atol=1e-5)
    np.testing.assert_allclose(found.velocity, path[:, 2:], atol=1e-4)
    assert found.determined.all()


def test_the_velocity_is_that_of_least_squares():
    rng = np.random.default_rng(2)
    sensors, moves, z = rng.normal(size=(5, 2)), rng.normal(size=(5, 2)), rng.normal(size=5)
    x = rng.normal(size=2)
    v, good = angle_observer.velocity_field(x, z, sensors=sensors, velocities=moves)
    off = x - sensors
    E = np.column_stack([-off[:, 1], off[:, 0]])
    B = off[:, 0] * moves[:, 1] - off[:, 1] * moves[:, 0] + z * (off**2).sum(1)
    np.testing.assert_allclose(v, np.linalg.lstsq(E, B, rcond=None)[0])
    assert good


def test_the_integration_is_that_of_another_solver():
    path, t = straight(60, DT), DT * np.arange(60)
    given = angle_observer.record(t, rates(path), CORNERS)
    start = path[0, :2] + [0.1, -0.05]

    def field(time, x):
        now = np.array([[*(path[0, :2] + time * path[0, 2:]), *path[0, 2:]]])
        z = rates(now)[0]
        return angle_observer.velocity_field(
            x, z, sensors=CORNERS, velocities=np.zeros_like(CORNERS)
        )[0]

    other = solve_ivp(field, (0.0, t[-1]), start, rtol=1e-10, atol=1e-12)
    found = angle_observer.observe(given, start)
    np.testing.assert_allclose(found.position[-1], other.y[:, -1], atol=1e-5)


def test_a_start_error_stays():
    path = straight(80, DT)
    given = angle_observer.record(DT * np.arange(80), rates(path), CORNERS)
    for angle in np.linspace(0, 2 * np.pi, 8, endpoint=False):
        off = 0.1 * np.array([np.cos(angle), np.sin(angle)])
        found = angle_observer.observe(given, path[0, :2] + off)
        assert np.hypot(*(found.position[-1] - path[-1, :2])) > 0.04


def test_sensors_that_move_are_taken_into_account():
    path, t = straight(60, DT), DT * np.arange(60)
    moving = CORNERS + 0.3 * np.sin(t)[:, None, None]
    own = np.broadcast_to(0.3 * np.cos(t)[:, None, None], moving.shape)
    off = path[:, None, :2] - moving
    v = path[:, None, 2:] - own
    z = (off[..., 0] * v[..., 1] - off[..., 1] * v[..., 0]) / (off**2).sum(-1)
    given = angle_observer.record(t, z, moving)
    np.testing.assert_allclose(given.velocities, own, atol=1e-4)
    found = angle_observer.observe(given, path[0, :2])
    np.testing.assert_allclose(found.position, path[:, :2], atol=1e-4)


def test_many_runs_are_one_by_one():
    path, t = straight(30, DT), DT * np.arange(30)
    rng = np.random.default_rng(5)
    z = rates(path) + 0.01 * rng.standard_normal((3, 30, 4))
    starts = path[0, :2] + 0.1 * rng.standard_normal((3, 2))
    together = angle_observer.observe(angle_observer.record(t, z, CORNERS), starts)
    for i in range(3):
        alone = angle_observer.observe(angle_observer.record(t, z[i], CORNERS), starts[i])
        np.testing.assert_allclose(together.position[i], alone.position, atol=1e-12)


def test_a_target_on_the_line_of_all_sensors_is_left_standing_and_told():
    line = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    v, good = angle_observer.velocity_field(
        np.array([3.0, 0.0]), np.ones(3), sensors=line, velocities=np.zeros((3, 2))
    )
    assert not good
    assert (v == 0.0).all()


@pytest.mark.parametrize(
    ("t", "z", "sensors", "word"),
    [
        (np.arange(3.0), np.zeros((3, 2)), CORNERS, "expected"),
        (np.zeros(3), np.zeros((3, 4)), CORNERS, "grow"),
        (np.arange(1.0), np.zeros((1, 4)), CORNERS, "grow"),
        (np.arange(3.0), np.full((3, 4), np.nan), CORNERS, "finite"),
    ],
)
def test_records_that_cannot_be_are_refused(t, z, sensors, word):
    with pytest.raises(InputError, match=word):
        angle_observer.record(t, z, sensors)
