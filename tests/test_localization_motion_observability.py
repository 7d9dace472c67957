"""What one moment tells of a state: ranks by an independent count, directions that are free."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from motion_scenes import RECTANGLE
from trackfield.errors import InputError
from trackfield.localization.motion_observability import observability, sensors_needed
from trackfield.sensing import motion_vector

SEEDS = st.integers(0, 2**32 - 1)


def scene(seed, n, count):
    rng = np.random.default_rng(seed)
    return rng.uniform(-1, 1, (count, n)), np.concatenate(
        [rng.uniform(-1, 1, n), rng.normal(size=n)]
    )


def outputs(kind, sensors, state):
    seen = motion_vector.sighting(sensors, state)
    match kind:
        case "motion":
            return motion_vector.scalar_output(seen)
        case "vector":
            return motion_vector.vector_output(seen).ravel()
        case "angular_rate":
            return motion_vector.angular_rates(seen).ravel()
        case _:
            return motion_vector.polar_angles(seen.offsets).ravel()


@pytest.mark.parametrize("kind", ["motion", "angular_rate", "vector"])
@pytest.mark.parametrize("n", [2, 3, 4])
@given(seed=SEEDS)
def test_as_many_sensors_as_needed_fix_the_state_and_one_less_does_not(kind, n, seed):
    needed = sensors_needed(kind, n)
    sensors, state = scene(seed, n, needed)
    enough = observability(sensors, state, kind=kind)
    assume(enough.condition < 1e6)  # not near a line or plane of sensors, by chance
    few = observability(sensors[1:], state, kind=kind)
    assert enough.observable
    assert not few.observable
    assert len(few.free) == 2 * n - few.rank > 0


def test_the_numbers_of_sensors_are_those_of_the_corrected_proposition():
    assert [sensors_needed("motion", n) for n in (2, 3)] == [4, 6]
    assert [sensors_needed("angular_rate", n) for n in (2, 3)] == [4, 3]
    assert sensors_needed("vector", 3) == 2
    assert sensors_needed("bearing", 2) is None


@pytest.mark.parametrize("kind", ["motion", "angular_rate", "vector", "bearing"])
@given(seed=SEEDS, n=st.integers(2, 4), count=st.integers(1, 3))
def test_along_a_free_direction_no_reading_changes_to_first_order(kind, seed, n, count):
    sensors, state = scene(seed, n, count)
    found = observability(sensors, state, kind=kind)
    assume(np.linalg.norm(state[:n] - sensors, axis=1).min() > 0.05)
    for free in found.free:
        h = 1e-4 / np.linalg.norm(free.direction)
        up, down = (outputs(kind, sensors, state + s * h * free.direction) for s in (1.0, -1.0))
        change = (up - down + math.pi) % (2 * math.pi) - math.pi if kind == "bearing" else up - down
        assert np.abs(change).max() < 1e-6 * max(1.0, np.abs(up).max() * 100)


def test_ranks_are_those_of_a_dense_jacobian_by_differences():
    for seed in range(20):
        sensors, state = scene(seed, 2, 1 + seed % 5)
        rows = (
            np.stack(
                [
                    (
                        outputs("motion", sensors, state + 1e-5 * e)
                        - outputs("motion", sensors, state - 1e-5 * e)
                    )
                    for e in np.eye(4)
                ],
                axis=-1,
            )
            / 2e-5
        )
        found = observability(sensors, state)
        tolerance = 1e-6 * np.linalg.norm(rows, 2)
        assert found.rank == np.linalg.matrix_rank(rows, tol=tolerance)
        assert found.place_rank == np.linalg.matrix_rank(rows[:, :2], tol=tolerance)
        assert found.velocity_rank == np.linalg.matrix_rank(rows[:, 2:], tol=tolerance)


def test_a_target_on_the_line_of_two_sensors_has_a_velocity_that_is_free_along_it():
    found = observability(RECTANGLE[:2], np.array([0.0, 0.15, 0.12, 0.01]))
    assert found.velocity_rank == 1
    assert "the velocity along (1, 0), the line of sight of all sensors" in {
        free.words for free in found.free
    }


def test_off_the_line_two_sensors_tell_the_velocity_unless_it_is_along_a_line_of_sight():
    away = observability(RECTANGLE[:2], np.array([0.1, 0.0, 0.12, 0.01]))
    along = observability(RECTANGLE[:2], np.array([0.1, 0.0, 0.2, 0.15]))  # to the first sensor
    assert (away.velocity_rank, along.velocity_rank) == (2, 1)


def test_a_target_at_rest_is_not_seen_at_all():
    found = observability(RECTANGLE, np.array([0.1, 0.05, 0.0, 0.0]))
    assert (found.rank, found.velocity_rank, len(found.free)) == (0, 0, 4)
    assert math.isinf(found.condition)
    rates = observability(RECTANGLE, np.array([0.1, 0.05, 0.0, 0.0]), kind="angular_rate")
    assert (rates.place_rank, rates.velocity_rank) == (0, 2)
    assert all(free.words.startswith("the place along") for free in rates.free)


def test_sensors_at_one_place_count_once_and_a_sensor_under_the_target_is_blind():
    state = np.array([0.07, 0.03, 0.1, -0.02])
    twice = observability(np.vstack([RECTANGLE[:3], RECTANGLE[:1]]), state)
    assert twice.rank == 3
    on = observability(np.vstack([RECTANGLE[:3], state[None, :2]]), state)
    assert on.blind == (3,)
    assert on.rank == 3


def test_condition_does_not_depend_on_units():
    state = np.array([0.07, 0.03, 0.1, -0.02])
    small = observability(RECTANGLE, state)
    large = observability(1e3 * RECTANGLE, np.concatenate([1e3 * state[:2], 2e4 * state[2:]]))
    assert small.condition == pytest.approx(large.condition, rel=1e-6)
    np.testing.assert_allclose(small.singular_values, large.singular_values, rtol=1e-6)


def test_four_sensors_in_a_plane_of_space_may_see_a_velocity_of_rank_two():
    sensors = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0], [0, -1.0, 0]])
    crossing = observability(sensors, np.array([0.0, 0, 0, 0.3, 0.2, 0.1]))
    assert crossing.velocity_rank == 2  # Remark 3, corrected: at the crossing of the diagonals
    beside = observability(sensors, np.array([0.1, 0.2, 0.3, 0.3, 0.2, 0.1]))
    assert beside.velocity_rank == 3


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: observability(RECTANGLE, np.zeros(4), kind="range"), "kind 'range'"),
        (lambda: observability(RECTANGLE, np.zeros(3)), "expected"),
        (lambda: observability(RECTANGLE, np.full(4, math.nan)), "finite"),
        (lambda: sensors_needed("range", 2), "kind 'range'"),
        (lambda: sensors_needed("motion", 1), "1 dimensions"),
    ],
)
def test_what_cannot_be_asked_is_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()
