"""Binary sensing, Oh III.A: regions against borders walked by hand, probabilities by counting."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackfield.errors import ConfigurationError, InputError
from trackfield.sensing import detection
from trackfield.sensing.detection import DetectionModel

L_SHAPE = ((-2.0, -2.0), (3.0, -2.0), (3.0, 0.0), (0.5, 0.5), (0.0, 4.0), (-2.0, 4.0))
MIXED = (
    DetectionModel(radius_m=3.0),
    DetectionModel(radius_m=4.0, heading_deg=30.0, width_deg=80.0, p_detection=0.9, edge_m=1.0),
    DetectionModel(radius_m=4.0, heading_deg=200.0, width_deg=290.0, p_false=0.0, edge_m=0.5),
    DetectionModel(polygon=L_SHAPE, p_detection=0.5, p_false=0.2, edge_m=2.0),
    DetectionModel(polygon=L_SHAPE[::-1]),
)
SENSORS = np.array([[0.0, 0.0], [1.0, 2.0], [-3.0, 0.5], [2.0, -1.0], [5.0, 5.0]])


def border(model):
    """Walk a region's border: its corners (k, 2), relative to the sensor."""
    if model.polygon:
        corners = np.array(model.polygon)
        share = np.linspace(0, 1, 4001)[:, None]
        pairs = zip(corners, np.roll(corners, -1, axis=0), strict=True)
        return np.concatenate([a + share * (b - a) for a, b in pairs])
    middle, half = np.radians([model.heading_deg, model.width_deg / 2])
    arc = np.linspace(middle - half, middle + half, 20_001)
    round_ = model.radius_m * np.stack([np.cos(arc), np.sin(arc)], axis=1)
    if model.width_deg == 360:
        return round_
    out = np.linspace(0, 1, 4001)[:, None]
    return np.concatenate([out * round_[0], round_, out[::-1] * round_[-1]])


def winding(points, p):
    """Turns of a closed line about p: not 0 inside."""
    angle = np.unwrap(np.arctan2(*(points - p).T[::-1]))
    end = np.arctan2(*(points[0] - p)[::-1])
    return round((angle[-1] + math.remainder(end - angle[-1], math.tau) - angle[0]) / math.tau)


def test_depth_is_the_distance_to_the_border_with_the_sign_of_being_inside():
    rng = np.random.default_rng(0)
    places = rng.uniform(-8, 10, (60, 2))
    found = detection.depth(detection.columns(MIXED), SENSORS, positions=places)
    for i, model in enumerate(MIXED):
        walk = border(model) + SENSORS[i]
        for p, value in zip(places, found[:, i], strict=True):
            least = np.linalg.norm(walk - p, axis=1).min()
            sign = 1 if winding(walk, p) else -1
            assert value == pytest.approx(sign * least, abs=2e-3)


def test_inside_at_the_sensor_and_on_the_border():
    one = DetectionModel(radius_m=5.0)
    places = np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 4.0001]])
    np.testing.assert_array_equal(
        detection.inside(one, np.zeros((1, 2)), positions=places)[:, 0], [True, True, False]
    )
    square = DetectionModel(polygon=((0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)))
    edge = np.array([[0.0, 1.0], [2.0, 2.0], [2.0, 1.0], [1.0, 0.0], [1.0, 1.0]])
    assert detection.inside(square, np.zeros((1, 2)), positions=edge).all()


def test_coverage_is_linear_over_the_edge_and_a_step_without():
    soft, hard = (DetectionModel(radius_m=5.0, edge_m=edge) for edge in (2.0, 0.0))
    x = np.array([0.0, 3.9, 4.5, 5.0, 5.5, 6.1])
    places = np.stack([x, np.zeros_like(x)], axis=1)
    c = detection.coverage(detection.columns([soft, hard]), np.zeros((2, 2)), positions=places)
    np.testing.assert_allclose(c[:, 0], [1, 1, 0.75, 0.5, 0.25, 0], atol=1e-12)
    np.testing.assert_array_equal(c[:, 1], [1, 1, 1, 1, 0, 0])


def test_a_target_that_is_not_there_covers_nothing():
    places = np.full((3, 2), np.nan)
    c = detection.coverage(detection.columns(MIXED), SENSORS, positions=places)
    np.testing.assert_array_equal(c, np.zeros((3, 5)))


def test_shapes_follow_the_positions_and_one_model_serves_all():
    places = np.zeros((7, 4, 2))
    assert detection.coverage(MIXED[1], SENSORS, positions=places).shape == (7, 4, 5)
    assert detection.coverage(MIXED[3], SENSORS, positions=places[0, 0]).shape == (5,)
    same = detection.columns([MIXED[3]] * 5)
    one = detection.coverage(MIXED[3], SENSORS, positions=places)
    np.testing.assert_array_equal(one, detection.coverage(same, SENSORS, positions=places))
    assert len(same.outlines) == 1
    repeated = detection.repeat(detection.columns(MIXED[3:4]), 5)
    for a, b in zip(repeated[:-1], same[:-1], strict=True):
        np.testing.assert_array_equal(a, b)


@given(st.integers(0, 2**32 - 1), st.floats(-180, 180), st.floats(5, 355))
def test_turning_and_moving_the_world_changes_nothing(seed, turn, width):
    rng = np.random.default_rng(seed)
    places, shift = rng.uniform(-6, 6, (20, 2)), rng.uniform(-50, 50, 2)
    c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    R = np.array([[c, -s], [s, c]])
    model = DetectionModel(radius_m=4.0, width_deg=width)
    turned = DetectionModel(radius_m=4.0, width_deg=width, heading_deg=turn)
    before = detection.depth(model, np.zeros((1, 2)), positions=places)
    after = detection.depth(turned, shift[None], positions=places @ R.T + shift)
    np.testing.assert_allclose(after, before, atol=1e-9)


@given(st.integers(0, 2**32 - 1), st.integers(0, 4))
def test_probability_is_the_mean_over_who_is_taken_for_inside(seed, k):
    rng = np.random.default_rng(seed)
    q, p = np.sort(rng.random(2))
    model = DetectionModel(p_detection=p, p_false=q)
    c, delivery = rng.random((k, 1)), rng.random()
    expected = 0.0
    for taken in itertools.product([0, 1], repeat=k):
        chance = math.prod(c[i, 0] if t else 1 - c[i, 0] for i, t in enumerate(taken))
        n = sum(taken)
        expected += chance * ((1 - (1 - model.p_detection) ** n) if n else q)
    found = detection.probability(model, c, delivery=delivery)
    np.testing.assert_allclose(found, delivery * expected, atol=1e-12)


def test_probability_of_targets_well_inside():
    model = DetectionModel(p_detection=0.7, p_false=0.05)
    for n, expected in ((0, 0.05), (1, 0.7), (2, 0.91), (3, 0.973)):
        c = np.zeros((5, 1))
        c[:n] = 1
        np.testing.assert_allclose(detection.probability(model, c), [expected])


def test_log_likelihood_counts_silence_and_is_finite_for_a_certain_model():
    P = np.array([0.7, 0.05, 1.0, 0.0])
    z = np.array([True, False, False, True])
    found = detection.log_likelihood(P, z)
    np.testing.assert_allclose(found[:2], np.log([0.7, 0.95]))
    np.testing.assert_allclose(found[2:], math.log(1e-12), rtol=1e-5)


def test_reach_is_where_coverage_ends():
    models = detection.columns(MIXED)
    reach = detection.reach(models)
    np.testing.assert_allclose(reach[[0, 1, 3]], [3.0, 4.5, math.hypot(2, 4) + 1.0])
    rng = np.random.default_rng(1)
    places = rng.uniform(-12, 12, (4000, 2))
    covered = detection.coverage(models, SENSORS, positions=places) > 0
    far = np.linalg.norm(places[:, None] - SENSORS, axis=2) > reach
    assert not (covered & far).any()


def test_draws_have_the_probabilities_of_the_model():
    models = detection.columns(MIXED)
    here = np.array([[0.5, 0.5], [1.5, 0.0], [np.nan, np.nan]])
    alive = np.array([True, True, True, True, False])
    delivery = np.array([1.0, 0.9, 0.5, 1.0, 1.0])
    drawn = detection.simulate(
        models,
        SENSORS,
        paths=np.broadcast_to(here, (40_000, 3, 2)),
        rng=np.random.default_rng(2),
        delivery=delivery,
        alive=alive,
    )
    c = detection.coverage(models, SENSORS, positions=here)
    for flags, share in ((drawn.detected, 1.0), (drawn.received, delivery)):
        expected = detection.probability(models, c, delivery=share) * alive
        error = np.abs(flags.mean(axis=0) - expected)
        assert (error <= 3.5 * np.sqrt(expected * (1 - expected) / 40_000)).all()
    assert not (drawn.received & ~drawn.detected).any()
    again = np.corrcoef(drawn.detected[:, 0], drawn.detected[:, 1])[0, 1]
    assert abs(again) < 0.02  # sensors are independent


@pytest.mark.parametrize(
    ("model", "words"),
    [
        (DetectionModel(radius_m=0.0), "radius_m: found 0, expected more than 0"),
        (DetectionModel(radius_m=math.nan), "radius_m: found nan"),
        (DetectionModel(p_detection=0.05), "expected more than p_false = 0.05"),
        (DetectionModel(p_detection=0.2, p_false=0.3), "expected more than p_false"),
        (DetectionModel(p_detection=1.2), "p_detection: found 1.2, expected 0 to 1"),
        (DetectionModel(p_false=math.nan), "p_false: found nan, expected 0 to 1"),
        (DetectionModel(edge_m=-1.0), "edge_m: found -1"),
        (DetectionModel(heading_deg=math.inf), "heading_deg: found inf, expected a finite number"),
        (DetectionModel(width_deg=0.0), "width_deg: found 0"),
        (DetectionModel(width_deg=361.0), "width_deg: found 361"),
        (DetectionModel(polygon=((0.0, 0.0), (1.0, 1.0))), "polygon: found 2 corners"),
        (DetectionModel(polygon=L_SHAPE, width_deg=90.0), "expected one region, not two"),
        (DetectionModel(polygon=((0, 0), (2, 2), (2, 0), (0, 2))), "cross or touch"),
        (DetectionModel(polygon=((0, 0), (4, 0), (4, 4), (2, 0), (0, 4))), "cross or touch"),
        (DetectionModel(polygon=((0, 0), (4, 0), (2, 0), (2, 3))), "cross or touch"),
        (DetectionModel(polygon=((0, 0), (4, 0), (1, 0))), "cross or touch"),
        (DetectionModel(polygon=((0, 0), (2, 1e-12), (4, 0))), "corners on one line"),
        (DetectionModel(polygon=((0, 0), (0, 0), (1, 0), (1, 1))), "two equal corners"),
        (DetectionModel(polygon=((0, 0), (1, 0), (math.nan, 1))), "pairs of finite numbers"),
    ],
)
def test_a_model_that_cannot_be_is_refused(model, words):
    assert any(words in problem for problem in detection.problems(model))
    with pytest.raises(ConfigurationError, match="sensor 1, "):
        detection.columns([MIXED[0], model, model])
    with pytest.raises(ConfigurationError):
        detection.coverage(model, SENSORS, positions=SENSORS)


def test_all_faults_are_told_at_once():
    wrong = DetectionModel(radius_m=-1, p_detection=2, edge_m=math.inf)
    with pytest.raises(ConfigurationError) as caught:
        detection.columns([wrong, DetectionModel(), wrong])
    assert len(caught.value.problems) == 3


def test_good_models_have_no_problems():
    assert not any(detection.problems(model) for model in MIXED)


def test_shapes_that_do_not_fit_are_refused():
    with pytest.raises(InputError, match=r"sensors of shape \(5, 3\)"):
        detection.coverage(MIXED[0], np.zeros((5, 3)), positions=np.zeros(2))
    with pytest.raises(InputError, match="expected one for all or one each"):
        detection.coverage(detection.columns(MIXED), SENSORS[:3], positions=np.zeros(2))
