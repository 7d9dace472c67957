"""Layouts: distances and densities of the lattices, and places tried for whether they are seen."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from trackfield.errors import InputError
from trackfield.network.boxes import Box, box_of
from trackfield.network.layouts import (
    covering,
    covering_spacing,
    lattice,
    lattice_count,
    lattice_spacing,
    on_surface,
    paraboloid,
    random_on_surface,
    random_places,
)
from trackfield.raster import Region

PLANE = {"square": (4, 1.0), "hexagonal": (6, np.sqrt(3) / 2)}
SPACE = {
    "cubic": (6, 1.0),
    "face-centred": (12, 1 / np.sqrt(2)),
    "body-centred": (8, 4 / np.sqrt(27)),
}
LATTICES = PLANE | SPACE  # neighbours of a node, and the volume of its cell, in spacings


def box_for(layout, size=(10.0, 8.0, 6.0)):
    d = 2 if layout in PLANE else 3
    return Box(np.full(d, -1.0), np.array(size[:d]) - 1.0)


@pytest.mark.parametrize("layout", LATTICES)
def test_a_lattice_has_its_neighbours_its_density_and_stands_in_the_middle(layout):
    neighbours, cell = LATTICES[layout]
    box = box_for(layout)
    nodes = lattice(box, 0.5, layout=layout)
    apart = cKDTree(nodes).query(nodes, k=neighbours + 2)[0][:, 1:]
    assert apart.min() == pytest.approx(0.5)
    inner = np.minimum(nodes - box.low, box.high - nodes).min(axis=1) > 1.0
    np.testing.assert_allclose(apart[inner][:, :neighbours], 0.5, rtol=1e-12)
    assert (apart[inner][:, neighbours] > 0.55).all()
    assert (box.outside(nodes) == 0).all()
    np.testing.assert_allclose(nodes.mean(axis=0), (box.low + box.high) / 2, atol=0.13)
    np.testing.assert_allclose(
        (nodes.min(axis=0) + nodes.max(axis=0)) / 2, (box.low + box.high) / 2, atol=1e-9
    )
    # In a large box the border counts for little: one node a cell.
    large = box_for(layout, (60.0, 50.0, 40.0))
    count = lattice_count(large, 1.0, layout=layout)
    assert count * cell == pytest.approx(large.measure, rel=0.06)
    assert count * cell <= large.measure


def test_rows_run_from_west_to_east_and_every_other_one_is_shifted():
    nodes = lattice(Region(0, 0, 4.5, 2 * np.sqrt(3)), 1.0, layout="hexagonal")
    rows = nodes.reshape(4, 4, 2)
    np.testing.assert_allclose(rows[0, :, 0], [0.5, 1.5, 2.5, 3.5])
    np.testing.assert_allclose(rows[1, :, 0], [1.0, 2.0, 3.0, 4.0])
    np.testing.assert_allclose(rows[:, 0, 1], np.sqrt(3) / 2 * (np.arange(4) + 0.5))
    np.testing.assert_allclose(
        lattice(Region(0, 0, 2, 3), 1.0),
        [[0.5, 0.5], [1.5, 0.5], [0.5, 1.5], [1.5, 1.5], [0.5, 2.5], [1.5, 2.5]],
    )


@given(
    layout=st.sampled_from(sorted(LATTICES)),
    size=st.tuples(*[st.floats(0.3, 9.0)] * 3),
    spacing=st.floats(0.3, 3.0),
)
def test_nodes_are_counted_as_they_are_set_up(layout, size, spacing):
    box = box_for(layout, size)
    assert len(lattice(box, spacing, layout=layout)) == lattice_count(box, spacing, layout=layout)


@given(layout=st.sampled_from(sorted(LATTICES)), count=st.integers(1, 3000))
def test_the_spacing_of_a_count_is_the_widest_that_has_it(layout, count):
    box = box_for(layout)
    spacing = lattice_spacing(box, count, layout=layout)
    assert lattice_count(box, spacing, layout=layout) >= count
    assert lattice_count(box, spacing * (1 + 1e-6), layout=layout) < count


def test_the_paper_s_441_nodes():
    assert lattice_spacing(Region(0, 0, 10, 10), 441) == pytest.approx(10 / 21)


@pytest.mark.parametrize("layout", LATTICES)
def test_times_that_a_place_is_covered_at_the_widest_spacing(layout):
    """Places tried at random: the k-th nearest node is within reach, and not much less."""
    d = 2 if layout in PLANE else 3
    box = Box(np.full(d, -5.0), np.full(d, 5.0))
    nodes = lattice(box, 1.0, layout=layout)
    places = np.random.default_rng(0).uniform(-1, 1, (60_000, d))
    kth = cKDTree(nodes).query(places, k=6)[0]
    for k in range(1, 7):
        farthest = 1 / covering_spacing(1.0, layout=layout, times=k)
        assert kth[:, k - 1].max() <= farthest + 1e-9
        assert kth[:, k - 1].max() >= (0.99 if d == 2 else 0.94) * farthest


def test_known_spacings_and_who_needs_fewest_nodes():
    found = {name: covering_spacing(2.0, layout=name) for name in LATTICES}
    assert found["hexagonal"] == pytest.approx(2 * np.sqrt(3))
    assert found["square"] == pytest.approx(2 * np.sqrt(2))
    assert found["face-centred"] == pytest.approx(2 * np.sqrt(2))
    assert found["body-centred"] == pytest.approx(2 * np.sqrt(12 / 5))
    # Balls over each place on average, for coverings: known thicknesses of the lattices.
    ball = {2: np.pi * 4, 3: 4 / 3 * np.pi * 8}
    thickness = {
        name: ball[2 if name in PLANE else 3] / (cell * found[name] ** (2 if name in PLANE else 3))
        for name, (_, cell) in LATTICES.items()
    }
    assert thickness["square"] == pytest.approx(1.5708, abs=1e-4)
    assert thickness["hexagonal"] == pytest.approx(1.2092, abs=1e-4)
    assert thickness["cubic"] == pytest.approx(2.7207, abs=1e-4)
    assert thickness["face-centred"] == pytest.approx(2.0944, abs=1e-4)
    assert thickness["body-centred"] == pytest.approx(1.4635, abs=1e-4)


@settings(max_examples=40)
@given(
    layout=st.sampled_from(sorted(LATTICES)),
    size=st.tuples(*[st.floats(0.2, 9.0)] * 3),
    seed=st.integers(0, 1000),
)
def test_a_covering_sees_every_place_of_its_region(layout, size, seed):
    box = box_for(layout, size)
    nodes = covering(box, 1.0, layout=layout)
    assert (box.outside(nodes) <= 1e-12).all()
    inside = np.random.default_rng(seed).uniform(box.low, box.high, (4000, box.dimensions))
    places = np.concatenate([inside, box.corners(), np.clip(inside * 1.5, box.low, box.high)])
    assert cKDTree(nodes).query(places)[0].max() <= 1.0 + 1e-9


@pytest.mark.parametrize(
    ("region", "reach", "hexagonal", "square"),
    [
        (Region(0, 0, 10, 10), 1.0, 4 * 6 + 3 * 7, 8 * 8),
        (Region(0, 0, 10, 8), 1.3, 5 * 5, 6 * 5),
        (Region(0, 0, np.sqrt(3), 1), 1.0, 1, 2),
    ],
)
def test_a_covering_is_counted_by_hand(region, reach, hexagonal, square):
    """Rows of whole and half cells, beginning with that which needs fewer nodes."""
    assert len(covering(region, reach)) == hexagonal
    assert len(covering(region, reach, layout="square")) == square


@pytest.mark.parametrize("layout", LATTICES)
def test_a_covering_needs_few_more_nodes_than_an_endless_one(layout):
    box = box_for(layout, (40.0, 40.0, 40.0))
    spacing = covering_spacing(1.5, layout=layout)
    least = box.measure / (LATTICES[layout][1] * spacing**box.dimensions)
    assert 1.0 <= len(covering(box, 1.5, layout=layout)) / least < 1.2


def test_random_places_are_uniform_and_repeat_with_their_seed():
    box = Box(np.array([0.0, 1.0, 2.0]), np.array([2.0, 4.0, 3.0]))
    places = random_places(box, 20_000, rng=np.random.default_rng(0))
    np.testing.assert_array_equal(places, random_places(box, 20_000, rng=np.random.default_rng(0)))
    shares = (places - box.low) / box.size
    counts = np.histogramdd(shares, bins=4, range=[(0, 1)] * 3)[0]
    assert ((counts - 312.5) ** 2 / 312.5).sum() < 63 + 4 * np.sqrt(2 * 63)


def test_the_bowl_of_the_paper_touches_floor_and_ceiling():
    box = Box(np.zeros(3), np.array([10.0, 10.0, 6.0]))
    ticks = np.linspace(0, 10, 21)
    places = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    nodes = on_surface(places, paraboloid(box))
    assert nodes.shape == (441, 3)
    assert (nodes[:, 2].min(), nodes[:, 2].max()) == pytest.approx((0.0, 6.0))
    np.testing.assert_allclose(nodes[:, 2], 6 / 50 * ((places - 5) ** 2).sum(axis=1), atol=1e-12)


def test_nodes_of_a_surface_are_uniform_in_its_own_area():
    """A tilted half and a flat half: as many nodes as square metres on each."""

    def roof(places):
        return 2.0 * np.maximum(places[:, 0] - 5.0, 0.0)

    nodes = random_on_surface(Region(0, 0, 10, 10), 4000, height=roof, rng=np.random.default_rng(1))
    np.testing.assert_allclose(nodes[:, 2], roof(nodes[:, :2]))
    share = np.sqrt(5) / (1 + np.sqrt(5))
    assert (nodes[:, 0] > 5).mean() == pytest.approx(share, abs=3 * np.sqrt(0.21 / 4000) + 0.01)


@given(seed=st.integers(0, 100), dimensions=st.sampled_from([2, 3]))
def test_distance_to_a_box(seed, dimensions):
    rng = np.random.default_rng(seed)
    low = rng.normal(size=dimensions)
    box = Box(low, low + rng.uniform(0.1, 2, dimensions))
    points = 3 * rng.normal(size=(20, dimensions))
    np.testing.assert_allclose(
        box.outside(points), np.linalg.norm(points - np.clip(points, *box), axis=1)
    )
    corners = box.corners()
    assert len(np.unique(corners, axis=0)) == 2**dimensions
    assert np.isin(corners, [*box.low, *box.high]).all()
    assert box.measure == pytest.approx(np.prod(box.high - box.low))


BOX = Box(np.zeros(3), np.ones(3))
PLAIN = Region(0, 0, 1, 1)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: lattice(PLAIN, 0.0), "above 0"),
        (lambda: lattice(PLAIN, np.inf), "above 0"),
        (lambda: lattice(PLAIN, 1e-6), "more than"),
        (lambda: lattice(PLAIN, 1e-320), "more than"),
        (lambda: lattice(PLAIN, 1.0, layout="diamond"), "expected one of square"),
        (lambda: lattice(BOX, 1.0), "2 dimensions, in a region of 3"),
        (lambda: lattice_spacing(PLAIN, 0), "from 1"),
        (lambda: covering_spacing(-1.0), "above 0"),
        (lambda: covering_spacing(1.0, times=7), "from 1 to 6"),
        (lambda: covering(PLAIN, 1e-5), "more than"),
        (lambda: random_places(PLAIN, -1, rng=np.random.default_rng(0)), "from 0"),
        (lambda: on_surface(np.zeros((2, 3)), paraboloid(BOX)), r"\(n, 2\)"),
        (lambda: on_surface(np.zeros((2, 2)), lambda p: p[:, 0] * np.nan), "finite numbers"),
        (lambda: box_of(Box(np.zeros(2), np.array([1.0, np.nan]))), "low below high"),
    ],
)
def test_what_cannot_be_set_up_is_refused(call, words):
    with pytest.raises(InputError, match=words):
        call()
