"""Places of sensors judged, and runs of readings surveyed chunk by chunk."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackfield.network.geometry import geometry, geometry_problems, thinness
from trackfield.network.site import Site, Target
from trackfield.network.survey import (
    data_problems,
    empty_survey,
    heard,
    median_value,
    surveyed,
    unit_suspicion,
)
from trackfield.sensing.range import UNCALIBRATED
from trackfield.types import Readings

SQUARE = [(0, 0, 0), (10, 0, 0), (10, 10, 0), (0, 10, 0)]


def make_site(places, **options):
    names = tuple("ABCDEFGHIJ"[: len(places)])
    models = (UNCALIBRATED,) * len(places)
    return Site("yard", names, np.array(places, float).reshape(-1, 3), models, **options)


def make_readings(t, sensor, value, target=None):
    n = len(t)
    return Readings(
        t_s=np.array(t, float),
        sensor=np.array(sensor, np.int32),
        value=np.array(value, float),
        target=np.zeros(n, np.int32) if target is None else np.array(target, np.int32),
        kind=np.zeros(n, np.int32),
        sigma=np.full(n, np.nan),
        arrival_s=np.full(n, np.nan),
        sensor_ids=("A", "B", "C", "D"),
        target_ids=("tag", "other"),
        kinds=("range",),
    )


def cut(readings, at):
    names = [f.name for f in dataclasses.fields(Readings) if "ids" not in f.name]
    columns = [n for n in names if n != "kinds"]
    halves = (slice(None, at), slice(at, None))
    return [
        dataclasses.replace(readings, **{n: getattr(readings, n)[half] for n in columns})
        for half in halves
    ]


def test_a_square_is_sound():
    found = geometry(make_site(SQUARE))
    assert found.problems == ()
    assert found.span_m == pytest.approx(200**0.5)


@given(
    st.integers(3, 8), st.floats(-3, 3), st.floats(1, 100), st.floats(-500, 500), st.floats(0, 0.4)
)
def test_a_line_is_found_wherever_it_lies_and_however_it_is_sampled(n, angle, step, x, jitter):
    along = step * (np.arange(n) + jitter * np.sin(np.arange(n)))
    places = np.column_stack([x + along * np.cos(angle), along * np.sin(angle), np.zeros(n)])
    assert "on a line" in geometry_problems(make_site(places))[0]
    across = np.zeros((n, 3))
    across[0, :2] = [-np.sin(angle), np.cos(angle)]
    assert geometry_problems(make_site(places + 0.05 * n * step * across)) == []


@pytest.mark.parametrize("n", [0, 1, 2])
def test_fewer_than_three_sensors_are_too_few(n):
    (problem,) = geometry_problems(make_site(SQUARE[:n]))
    assert f"found {n} sensors" in problem


def test_some_of_the_sensors_may_be_judged():
    assert geometry(make_site(SQUARE), ("A", "B", "C")).problems == ()
    assert "found 2 sensors (A, C)" in geometry(make_site(SQUARE), ("A", "C")).problems[0]


def test_one_plane_is_remarked_in_3d_only():
    solid = [*SQUARE, (5, 5, 4)]
    deep = {"target": Target(dimensions=3)}
    assert "one plane" in geometry(make_site(SQUARE, **deep)).remarks[0]
    assert "one plane" in geometry(make_site(SQUARE[:3], **deep)).remarks[0]
    assert geometry(make_site(solid, **deep)).remarks == ()
    assert geometry(make_site(SQUARE)).remarks == ()


def test_thinness_is_the_ratio_of_extents():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(50_000, 2)) * [10.0, 1.0]
    assert thinness(points) == pytest.approx(0.1, rel=0.02)


def test_a_survey_counts_what_comes_twice_late_and_after_a_gap():
    readings = make_readings([0, 1, 1, 3, 2.5, 9, 1], [0, 1, 1, 2, 3, 0, 1], [5] * 7)
    found = surveyed(empty_survey(make_site(SQUARE)), readings)
    assert found.timing.rows == 7
    assert found.per_sensor.tolist() == [2, 3, 1, 1]
    assert (found.timing.first_s, found.timing.last_s) == (0.0, 9.0)
    assert found.timing.longest_gap_s == 6.0
    assert found.timing.repeated == 2
    assert (found.timing.unordered, found.timing.late_s, found.timing.behind) == (2, 8.0, 1)
    assert heard(found) == ("A", "B", "C", "D")


@given(st.integers(0, 40))
def test_a_survey_does_not_depend_on_how_a_run_is_cut(at):
    rng = np.random.default_rng(3)
    t = np.round(np.arange(40) * 0.3 + rng.normal(size=40), 1)
    readings = make_readings(t, rng.integers(0, 4, 40), rng.uniform(1, 9, 40))
    whole = surveyed(empty_survey(make_site(SQUARE)), readings)
    parts = empty_survey(make_site(SQUARE))
    for chunk in cut(readings, at):
        parts = surveyed(parts, chunk)
    for name in (
        "rows", "first_s", "last_s", "longest_gap_s", "repeated", "unordered", "behind"
    ):  # fmt: skip
        assert getattr(whole.timing, name) == getattr(parts.timing, name), name
    np.testing.assert_array_equal(whole.per_sensor, parts.per_sensor)


def test_the_typical_range_is_that_of_most_readings():
    survey = empty_survey(make_site(SQUARE))
    for value, n in ((5.0, 10), (7.0, 30), (900.0, 15)):
        survey = surveyed(survey, make_readings(range(n), [0] * n, [value] * n))
    assert median_value(survey) == 7.0


@pytest.mark.parametrize(
    ("value", "said"),
    [(7.0, None), (0.3, None), (300.0, None), (7000.0, "large"), (0.007, "small")],
)
def test_another_unit_is_suspected_by_a_factor_of_a_thousand(value, said):
    readings = make_readings([0, 1, 2, 3], [0, 1, 2, 3], [value] * 4)
    suspicion = unit_suspicion(surveyed(empty_survey(make_site(SQUARE)), readings))
    assert (suspicion is None) if said is None else (f"far too {said}" in suspicion)


def test_what_keeps_a_run_from_being_tracked():
    site = make_site(SQUARE)
    assert "found no readings" in data_problems(empty_survey(site))[0]
    two = surveyed(empty_survey(site), make_readings([0, 1], [0, 1], [5, 5]))
    assert "found 2 sensors (A, B)" in data_problems(two)[0]
    three = surveyed(empty_survey(site), make_readings([0, 1, 2], [0, 1, 2], [5, 5, 5]))
    assert data_problems(three) == ()
