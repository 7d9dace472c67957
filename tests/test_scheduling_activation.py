"""Region R and nodes ahead of targets: all nodes asked one by one, and targets that really move."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from trackfield.errors import InputError
from trackfield.linalg import gate
from trackfield.motion import ConstantVelocity, SteppedAcceleration
from trackfield.network.node_index import NodeIndex
from trackfield.scheduling.activation import Zone, activate, wake_ahead
from trackfield.scheduling.ellipsoids import distance_to_ellipsoid

ZONE = Zone(near_m=1.5, far_m=2.5, half_angle_rad=0.6)


def random_field(seed, dimensions=2, count=400):
    return NodeIndex(np.random.default_rng(seed).uniform(0, 10, (count, dimensions)))


def in_region(node, target, heading, zone):
    """The definition, for one node."""
    offset = node - target
    far = np.linalg.norm(offset)
    if far <= zone.near_m:
        return True
    cosine = offset @ heading / (far * np.linalg.norm(heading)) if heading.any() else 1.0
    return bool(far <= zone.far_m and np.arccos(np.clip(cosine, -1, 1)) <= zone.half_angle_rad)


@settings(max_examples=60)
@given(
    seed=st.integers(0, 10_000),
    dimensions=st.sampled_from([2, 3]),
    angle=st.floats(0.01, np.pi),
    radii=st.tuples(st.floats(0, 3), st.floats(0, 3)),
)
def test_a_node_is_awake_if_and_only_if_it_is_in_the_region(seed, dimensions, angle, radii):
    rng = np.random.default_rng(seed)
    nodes = random_field(seed, dimensions, count=80)
    targets = rng.uniform(-1, 11, (3, dimensions))
    headings = rng.normal(size=(3, dimensions)) * [[1.0], [0.0], [1e-3]]
    zone = Zone(min(radii), max(radii), angle)
    found = activate(nodes, targets, headings=headings, zone=zone)
    expected = [
        (t, n)
        for t in range(3)
        for n in range(80)
        if in_region(nodes.positions[n], targets[t], headings[t], zone)
    ]
    assert list(zip(found.track.tolist(), found.node.tolist(), strict=True)) == expected
    distance = np.linalg.norm(nodes.positions[found.node] - targets[found.track], axis=1)
    np.testing.assert_array_equal(found.near, distance <= zone.near_m)


def test_the_borders_of_the_region_belong_to_it_in_spite_of_rounding():
    """Nodes on both circles and both edges, about a target whose place is not exact."""
    spin = np.pi / 7 + np.array([-0.6, 0.6, 0.0, 2.0])
    radius = np.array([2.0, 2.0, 2.5, 1.5])
    target = np.array([[0.1, 0.7]])
    on = target + radius[:, None] * np.column_stack([np.cos(spin), np.sin(spin)])
    beyond = target + 1.001 * (on - target)
    wide = np.pi / 7 + np.array([-0.601, 0.601])
    beyond[:2] = target + 2.0 * np.column_stack([np.cos(wide), np.sin(wide)])
    heading = np.array([[np.cos(np.pi / 7), np.sin(np.pi / 7)]])
    assert activate(NodeIndex(on), target, headings=heading, zone=ZONE).node.size == 4
    assert activate(NodeIndex(beyond), target, headings=heading, zone=ZONE).node.size == 0


def test_volume_of_the_cone():
    """Share of nodes awake in space against the volume of a ball and a spherical sector."""
    rng = np.random.default_rng(1)
    nodes = NodeIndex(rng.uniform(0, 10, (40_000, 3)))
    found = activate(nodes, np.full((1, 3), 5.0), headings=np.array([[1.0, 2.0, 3.0]]), zone=ZONE)
    sector = 2 * np.pi / 3 * (1 - np.cos(0.6)) * (2.5**3 - 1.5**3)
    expected = 40 * (4 * np.pi / 3 * 1.5**3 + sector)
    assert found.node.size == pytest.approx(expected, abs=4 * np.sqrt(expected))


@settings(max_examples=40)
@given(seed=st.integers(0, 10_000), dimensions=st.sampled_from([2, 3]), flat=st.booleans())
def test_distance_to_an_ellipsoid_is_the_least_to_any_of_its_points(seed, dimensions, flat):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(dimensions, dimensions)) * np.exp(rng.normal(size=dimensions))
    if flat:
        root[:, 0] = 0.0
    offsets = 3.0 * rng.normal(size=(4, dimensions))
    covariance = root @ root.T
    found = distance_to_ellipsoid(offsets, covariance[None], 4.0, which=np.zeros(4, int))
    for offset, distance in zip(offsets, found, strict=True):
        # Points of the ellipsoid are root u with |u| <= 2; least distance over u.
        best = minimize(
            lambda u, at=offset: np.sum((root @ u - at) ** 2),
            np.zeros(dimensions),
            jac=lambda u, at=offset: 2 * root.T @ (root @ u - at),
            constraints={"type": "ineq", "fun": lambda u: 4 - u @ u, "jac": lambda u: -2 * u},
            method="SLSQP",
            options={"ftol": 1e-14, "maxiter": 500},
        )
        assert distance == pytest.approx(np.sqrt(best.fun), rel=1e-4, abs=2e-5)


def test_nodes_within_reach_of_a_moving_target_are_awake_as_often_as_asked():
    """Targets move as the motion says; whoever is near one at a step was woken by then."""
    rng = np.random.default_rng(3)
    nodes, motion, reach = random_field(0, count=600), ConstantVelocity(0.05), 1.2
    mean = np.array([[3.0, 4.0, 0.8, 0.3]])
    root = np.diag([0.2, 0.1, 0.15, 0.15])
    covariance = root @ root.T
    steps = np.array([0.5, 1.0, 1.5])
    ahead = wake_ahead(
        nodes,
        mean,
        covariances=covariance[None],
        motion=motion,
        steps_s=steps,
        reach_m=reach,
        probability=0.9,
    )
    since = np.full(len(nodes), 99)
    since[ahead.node] = ahead.step
    states = mean + rng.normal(size=(4000, 4)) @ root.T
    F, noise = motion.transition(0.5), np.linalg.cholesky(motion.noise(0.5))
    for step in range(1, 4):
        states = states @ F.T + rng.normal(size=states.shape) @ noise.T
        near = np.linalg.norm(states[:, None, :2] - nodes.positions, axis=2) <= reach
        asleep = (near & (since > step)).any(axis=1)
        assert asleep.mean() <= 0.1 + 3 * np.sqrt(0.09 / 4000)
    assert 0 < ahead.node.size < len(nodes) / 3
    assert set(ahead.step.tolist()) == {1, 2, 3}


def test_woken_nodes_are_those_within_reach_of_a_predicted_ellipsoid():
    """Each node, track and step asked by itself; in space, with a noise of half rank."""
    rng = np.random.default_rng(5)
    nodes, motion = random_field(1, 3, count=300), SteppedAcceleration((0.2, 0.1, 0.0))
    reach = rng.uniform(0.3, 1.2, 300)
    means = np.hstack([rng.uniform(2, 8, (4, 3)), rng.normal(size=(4, 3))])
    roots = 0.3 * rng.normal(size=(4, 6, 6))
    covariances = roots @ np.swapaxes(roots, 1, 2)
    steps = np.array([0.5, 1.0])
    found = wake_ahead(
        nodes, means, covariances=covariances, motion=motion, steps_s=steps, reach_m=reach
    )
    limit = float(gate(0.95, 3))
    expected = {}
    for k, dt in reversed(list(enumerate(steps, start=1))):
        F = motion.transition(dt)
        for track in range(4):
            P = (F @ covariances[track] @ F.T + motion.noise(dt))[:3, :3]
            offsets = nodes.positions - (F @ means[track])[:3]
            apart = distance_to_ellipsoid(offsets, P[None], limit, which=np.zeros(300, int))
            expected |= {(track, int(n)): k for n in np.flatnonzero(apart <= reach)}
    pairs = zip(found.track.tolist(), found.node.tolist(), found.step.tolist(), strict=True)
    assert {(t, n): k for t, n, k in pairs} == expected
    assert found.node.size == len(expected) > 100


def test_nobody_wakes_without_targets():
    nodes = random_field(0)
    none = np.empty((0, 2))
    assert activate(nodes, none, headings=none, zone=ZONE).node.size == 0
    ahead = wake_ahead(
        nodes,
        np.empty((0, 4)),
        covariances=np.empty((0, 4, 4)),
        motion=ConstantVelocity(1.0),
        steps_s=np.array([1.0]),
        reach_m=1.0,
    )
    assert ahead.node.size == 0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"zone": Zone(2.0, 1.0, 0.5)}, "near_m <= far_m"),
        ({"zone": Zone(-1.0, 1.0, 0.5)}, "near_m <= far_m"),
        ({"zone": Zone(1.0, np.nan, 0.5)}, "near_m <= far_m"),
        ({"zone": Zone(1.0, 2.0, 4.0)}, "from 0 to pi"),
        ({"headings": np.zeros((2, 2))}, "one a position"),
        ({"headings": np.full((1, 2), np.nan)}, "finite"),
        ({"positions": np.zeros((1, 3)), "headings": np.zeros((1, 3))}, r"\(p, 2\)"),
        ({"positions": np.full((1, 2), np.inf)}, "no number"),
    ],
)
def test_what_has_no_region_is_refused(change, words):
    given = {"positions": np.zeros((1, 2)), "headings": np.ones((1, 2)), "zone": ZONE} | change
    positions = given.pop("positions")
    with pytest.raises(InputError, match=words):
        activate(random_field(0), positions, **given)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"means": np.zeros((1, 6))}, r"\(t, 4\)"),
        ({"covariances": np.full((1, 4, 4), np.nan)}, "no number"),
        ({"probability": 1.0}, "between 0 and 1"),
        ({"reach_m": -np.inf}, "no number above 0"),
        ({"reach_m": np.ones(3)}, "one number or 400"),
    ],
)
def test_a_belief_that_is_none_is_refused(change, words):
    given = {
        "means": np.zeros((1, 4)),
        "covariances": np.eye(4)[None],
        "motion": ConstantVelocity(1.0),
        "steps_s": np.array([1.0]),
        "reach_m": 1.0,
    } | change
    means = given.pop("means")
    with pytest.raises(InputError, match=words):
        wake_ahead(random_field(0), means, **given)


@pytest.mark.parametrize(
    ("positions", "words"),
    [
        (np.empty((0, 2)), "n > 0"),
        (np.zeros((3, 1)), r"\(n, 2\) or \(n, 3\)"),
        (np.array([[0.0, np.nan]]), "number 0"),
    ],
)
def test_nodes_that_stand_nowhere_are_refused(positions, words):
    with pytest.raises(InputError, match=words):
        NodeIndex(positions)


def test_an_index_tells_its_size():
    nodes = random_field(0, 3, count=7)
    assert (len(nodes), nodes.dimensions) == (7, 3)


@pytest.mark.speed
def test_the_regions_of_twenty_targets_are_found_faster_than_all_distances():
    """Of 10,000 nodes: about a fifteenth of the time of measuring the way to each of them."""
    rng = np.random.default_rng(0)
    nodes = NodeIndex(rng.uniform(0, 100, (10_000, 2)))
    positions, headings = rng.uniform(0, 100, (20, 2)), rng.normal(size=(20, 2))
    ours, plain = [], []
    for _ in range(20):
        begun = time.process_time()
        found = activate(nodes, positions, headings=headings, zone=ZONE)
        done = time.process_time()
        ours.append(done - begun)
        far = np.linalg.norm(nodes.positions - positions[:, None], axis=2)
        plain.append(time.process_time() - done)
    assert (far[found.track, found.node] <= ZONE.far_m).all()
    assert min(ours) < 1.5 * 0.08 * min(plain), (min(ours), min(plain))
