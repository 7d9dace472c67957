"""Coverage and holes against places tried at random, lattices with closed forms, and Voronoi."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import Voronoi, cKDTree

from trackfield.errors import InputError
from trackfield.network.boxes import Box
from trackfield.network.coverage import count_cells, count_map, coverage, times_seen
from trackfield.network.holes import holes
from trackfield.network.layouts import covering, covering_spacing, lattice
from trackfield.network.node_index import NodeIndex
from trackfield.raster import Region

FIELD = Region(-1.0, 2.0, 9.0, 9.0)
SPACE = Box(np.array([0.0, 0.0, 0.0]), np.array([6.0, 5.0, 4.0]))


def seen_by(nodes, reach, places):
    apart = np.linalg.norm(places[:, None] - nodes, axis=2)
    return (apart <= reach).sum(axis=1)


@settings(max_examples=40)
@given(
    seed=st.integers(0, 10_000),
    count=st.integers(1, 60),
    reach=st.tuples(st.floats(0.1, 12.0), st.floats(0.1, 12.0)),
)
def test_shares_of_a_plane_are_those_of_places_tried(seed, count, reach):
    """Nodes in and around a region that is no square, each with its own reach."""
    rng = np.random.default_rng(seed)
    nodes = rng.uniform([-4, -1], [12, 12], (count, 2))
    radii = rng.uniform(min(reach), max(reach), count)
    found = coverage(NodeIndex(nodes), FIELD, reach_m=radii, times=5)
    places = rng.uniform(FIELD[:2], FIELD[2:], (4000, 2))
    seen = seen_by(nodes, radii, places)
    for k, share in enumerate(found.share, start=1):
        spread = math.sqrt(max(share * (1 - share), 1e-3) / 4000)
        assert (seen >= k).mean() == pytest.approx(share, abs=5 * spread)
    assert (np.diff(found.share) <= 1e-12).all()
    assert found.least <= seen.min()


def disc_area(reach):
    return math.pi * reach**2


def lens(reach, apart):
    half = apart / 2
    return 2 * (reach**2 * math.acos(half / reach) - half * math.sqrt(reach**2 - half**2))


def test_areas_of_discs_and_lenses():
    field = Region(-10, -10, 10, 10)
    one = NodeIndex(np.array([[1.0, 2.0]]))
    assert coverage(one, field, reach_m=3.0).share[0] * 400 == pytest.approx(disc_area(3.0))
    edge = NodeIndex(np.array([[10.0, 0.0]]))
    assert coverage(edge, field, reach_m=3.0).share[0] * 400 == pytest.approx(disc_area(3.0) / 2)
    corner = NodeIndex(np.array([[-10.0, 10.0]]))
    assert coverage(corner, field, reach_m=3.0).share[0] * 400 == pytest.approx(disc_area(3.0) / 4)
    two = NodeIndex(np.array([[-1.0, 0.5], [1.5, 0.5]]))
    shares = coverage(two, field, reach_m=3.0, times=3).share * 400
    both = lens(3.0, 2.5)
    np.testing.assert_allclose(shares, [2 * disc_area(3.0) - both, both, 0.0], atol=1e-12)
    nested = NodeIndex(np.array([[0.0, 0.0], [0.5, 0.0]]))
    shares = coverage(nested, field, reach_m=np.array([3.0, 1.0]), times=2).share * 400
    np.testing.assert_allclose(shares, [disc_area(3.0), disc_area(1.0)])
    same = NodeIndex(np.array([[1.0, 1.0]] * 3))
    shares = coverage(same, field, reach_m=2.0, times=4).share * 400
    np.testing.assert_allclose(shares, [disc_area(2.0)] * 3 + [0.0], atol=1e-12)
    touching = NodeIndex(np.array([[0.0, 0.0], [1.0, 0.0]]))
    shares = coverage(touching, field, reach_m=np.array([2.0, 1.0]), times=2).share * 400
    np.testing.assert_allclose(shares, [disc_area(2.0), disc_area(1.0)])


def test_a_disc_around_the_region_sees_all_of_it():
    found = coverage(NodeIndex(np.array([[3.0, 5.0], [50.0, 5.0]])), FIELD, reach_m=30.0)
    np.testing.assert_array_equal(found.share, [1.0, 0.0, 0.0, 0.0])
    assert found.least == 1


@pytest.mark.parametrize("layout", ["square", "hexagonal"])
@pytest.mark.parametrize("times", [1, 2, 3])
def test_a_lattice_covers_from_its_covering_spacing_on(layout, times):
    """The border left out: nodes reach beyond it on all sides."""
    nodes = NodeIndex(lattice(Region(-6, -6, 6, 6), 1.0, layout=layout))
    reach = 1.0 / covering_spacing(1.0, layout=layout, times=times)
    field = Region(-2, -2, 2, 2)
    for factor in (1 - 1e-3, 1 + 1e-3):
        found = coverage(nodes, field, reach_m=reach * factor, times=times)
        assert (found.least < times) == (factor < 1)
        assert (found.share[-1] < 1 - 1e-9) == (factor < 1)


def test_share_of_a_square_lattice_in_closed_form():
    """With reach below half a pitch discs are apart; up to the diagonal, pairs overlap."""
    nodes = NodeIndex(lattice(Region(0, 0, 10, 10), 1.0))
    assert coverage(nodes, Region(0, 0, 10, 10), reach_m=0.45).share[0] == pytest.approx(
        disc_area(0.45)
    )
    inner = Region(3, 3, 7, 7)
    shares = coverage(nodes, inner, reach_m=0.6, times=2).share
    np.testing.assert_allclose(shares, [disc_area(0.6) - 2 * lens(0.6, 1.0), 2 * lens(0.6, 1.0)])


def test_slivers_count_that_no_raster_shows():
    """Pham's field, with circles that touch its border: 10 nodes along a thin strip, else 11."""
    ticks = 0.5 * np.arange(21)
    nodes = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    field = Region(0, 0, 10, 10)
    found = coverage(NodeIndex(nodes), field, reach_m=1.5, times=11)
    assert found.least == 10
    assert 0 < 1 - found.share[-1] < 1e-5
    assert count_cells(NodeIndex(nodes), field, reach_m=1.5, cell_m=0.05).middle.min() == 11
    assert seen_by(nodes, 1.5, np.array([[3.8e-4, 0.0419]]))[0] == 10


@pytest.mark.parametrize("seed", range(3))
def test_shares_of_space_hold_between_their_bounds(seed):
    rng = np.random.default_rng(seed)
    nodes = rng.uniform(SPACE.low - 0.5, SPACE.high + 0.5, (60, 3))
    radii = rng.uniform(0.8, 1.6, 60)
    places = rng.uniform(SPACE.low, SPACE.high, (30_000, 3))
    seen = seen_by(nodes, radii, places)
    before = np.ones(4)
    for cell in (0.3, 0.15, 0.08):
        found = coverage(NodeIndex(nodes), SPACE, reach_m=radii, cell_m=cell)
        assert (found.low <= found.share).all()
        assert (found.share <= found.high).all()
        assert ((found.high - found.low) < before).all()
        before = found.high - found.low
        assert (found.cell_m < cell * 1.1).all()
        for k in range(1, 5):
            tried = (seen >= k).mean()
            assert found.low[k - 1] - 0.012 <= tried <= found.high[k - 1] + 0.012
            assert found.share[k - 1] == pytest.approx(tried, abs=0.02)
        assert found.least <= seen.min()


def test_the_bounds_of_a_ball_hold_wherever_its_cells_lie():
    rng = np.random.default_rng(3)
    box = Box(np.zeros(3), np.full(3, 4.0))
    for _ in range(20):
        reach = rng.uniform(0.8, 1.4)
        ball = NodeIndex(rng.uniform(1.5, 2.5, (1, 3)))
        found = coverage(ball, box, reach_m=reach, times=1, cell_m=0.2)
        exact = 4 / 3 * math.pi * reach**3 / 64
        shell = 4 * math.pi * reach**2 / 64 * np.linalg.norm(found.cell_m) / 2
        assert found.low[0] < exact < found.high[0]
        assert exact - found.low[0] == pytest.approx(shell, rel=0.3)
        assert found.high[0] - exact == pytest.approx(shell, rel=0.3)


def test_a_hole_between_all_middles_is_not_taken_for_seen():
    nodes = NodeIndex(lattice(Box(np.full(3, -2.0), np.full(3, 6.0)), 1.0, layout="cubic"))
    field = Box(np.zeros(3), np.full(3, 4.0))
    found = coverage(nodes, field, reach_m=np.sqrt(0.75) - 0.01, cell_m=0.2)
    assert found.share[0] == 1.0
    assert found.low[0] < 1.0
    assert found.least == 0


@pytest.mark.parametrize("layout", ["cubic", "face-centred", "body-centred"])
def test_a_covering_of_space_leaves_nothing_out(layout):
    nodes = NodeIndex(covering(SPACE, 1.5, layout=layout))
    found = coverage(nodes, SPACE, reach_m=1.5 * 1.1, cell_m=0.1)
    assert found.least >= 1
    assert found.low[0] == 1.0
    assert not holes(nodes, SPACE, reach_m=1.5, cell_m=0.1)


def test_a_map_counts_what_each_middle_sees():
    rng = np.random.default_rng(2)
    nodes, radii = rng.uniform([-1, 2], [9, 9], (30, 2)), rng.uniform(0.5, 3.0, 30)
    raster = count_map(NodeIndex(nodes), FIELD, reach_m=radii, cell_m=0.25)
    assert raster.values.shape == (28, 40)
    expected = seen_by(nodes, radii, raster.centres())
    np.testing.assert_array_equal(raster.values.ravel(), expected)


@pytest.mark.parametrize("dimensions", [2, 3])
def test_places_of_any_kind_are_counted_as_they_are_seen(dimensions):
    rng = np.random.default_rng(dimensions)
    nodes, places = rng.uniform(0, 6, (80, dimensions)), rng.uniform(-1, 7, (500, dimensions))
    radii = rng.uniform(0.5, 2.0, 80)
    found = times_seen(NodeIndex(nodes), places, reach_m=radii)
    np.testing.assert_array_equal(found, seen_by(nodes, radii, places))


def farthest_point(nodes, region):
    """Of a region, by Voronoi: nodes mirrored at the sides make vertices of what meets them."""
    box = np.array(region).reshape(2, 2)
    every = [nodes]
    for axis in range(2):
        for side in box[:, axis]:
            mirrored = nodes.copy()
            mirrored[:, axis] = 2 * side - mirrored[:, axis]
            every.append(mirrored)
    every += [2 * np.array([x, y]) - nodes for x in box[:, 0] for y in box[:, 1]]
    vertices = Voronoi(np.concatenate(every)).vertices
    inside = ((vertices > box[0] - 1e-9) & (vertices < box[1] + 1e-9)).all(axis=1)
    distance = cKDTree(nodes).query(vertices[inside])[0]
    return vertices[inside][np.argmax(distance)], distance.max()


@pytest.mark.parametrize("seed", range(6))
def test_the_deepest_point_of_all_holes_is_the_farthest_voronoi_vertex(seed):
    nodes = np.random.default_rng(seed).uniform(FIELD[:2], FIELD[2:], (40, 2))
    deepest = max(holes(NodeIndex(nodes), FIELD, reach_m=0.7), key=lambda hole: hole.gap_m)
    place, distance = farthest_point(nodes, FIELD)
    np.testing.assert_allclose(deepest.deepest, place, atol=1e-8)
    assert deepest.nearest_m == pytest.approx(distance, abs=1e-11)
    assert deepest.gap_m == pytest.approx(distance - 0.7, abs=1e-11)


def test_a_hole_has_the_area_and_centre_that_were_cut_out():
    nodes = lattice(Region(0, 0, 12, 12), 0.5)
    gone = np.linalg.norm(nodes - [4.0, 7.0], axis=1) < 2.0
    field, reach = Region(0, 0, 12, 12), 0.5
    found = holes(NodeIndex(nodes[~gone]), field, reach_m=reach, cell_m=0.02)
    (hole,) = found
    exact = (1 - coverage(NodeIndex(nodes[~gone]), field, reach_m=reach).share[0]) * 144
    assert hole.measure == pytest.approx(exact, rel=5e-3)
    np.testing.assert_allclose(hole.centroid, [4.0, 7.0], atol=1e-2)
    np.testing.assert_allclose(hole.deepest, [4.0, 7.0], atol=1e-6)
    np.testing.assert_allclose(hole.gap_m, np.hypot(1.75, 1.25) - 0.5, atol=0.25)
    apart = np.linalg.norm(nodes[~gone] - hole.deepest, axis=1)
    assert hole.nearest_m == pytest.approx(apart.min())


@pytest.mark.parametrize("times", [1, 2, 3])
def test_holes_are_all_that_is_not_seen_and_apart_from_each_other(times):
    rng = np.random.default_rng(times)
    nodes, radii = rng.uniform(FIELD[:2], FIELD[2:], (50, 2)), rng.uniform(0.6, 2.0, 50)
    found = holes(NodeIndex(nodes), FIELD, reach_m=radii, times=times, cell_m=0.05)
    exact = (1 - coverage(NodeIndex(nodes), FIELD, reach_m=radii, times=times).share[-1]) * 70
    assert len(found) > 1
    assert sum(hole.measure for hole in found) == pytest.approx(exact, abs=0.3)
    assert [hole.measure for hole in found] == sorted((h.measure for h in found), reverse=True)
    for hole in found:
        gaps = np.sort(np.linalg.norm(nodes - hole.deepest, axis=1) - radii)
        assert hole.gap_m == pytest.approx(gaps[times - 1])
        assert hole.gap_m > 0
        around = hole.deepest + 1e-3 * rng.normal(size=(50, 2))
        around = np.clip(around, FIELD[:2], FIELD[2:])
        other = np.sort(np.linalg.norm(nodes - around[:, None], axis=2) - radii, axis=1)
        assert (other[:, times - 1] <= hole.gap_m + 1e-9).all()


def test_a_hole_in_space():
    nodes = lattice(SPACE, 0.5, layout="cubic")
    gone = np.linalg.norm(nodes - [3.0, 2.5, 2.0], axis=1) < 1.1
    (hole,) = holes(NodeIndex(nodes[~gone]), SPACE, reach_m=0.5, cell_m=0.05)
    np.testing.assert_allclose(hole.centroid, [3.0, 2.5, 2.0], atol=1e-2)
    apart = np.linalg.norm(nodes[~gone] - hole.deepest, axis=1)
    assert hole.nearest_m == pytest.approx(apart.min())
    assert hole.gap_m == pytest.approx(apart.min() - 0.5, abs=1e-8)
    assert 4 / 3 * np.pi * 0.6**3 < hole.measure < 4 / 3 * np.pi * 1.3**3


def test_a_field_without_holes_has_none():
    assert holes(NodeIndex(np.array([[4.0, 5.0]])), FIELD, reach_m=30.0) == ()


def test_coarse_cells_are_chosen_where_fine_ones_would_be_too_many():
    tiny = count_cells(NodeIndex(np.zeros((1, 2))), Region(0, 0, 1000, 1000), reach_m=0.1)
    assert 3_000_000 < tiny.middle.size <= 4_000_000


ONE = NodeIndex(np.zeros((1, 2)))


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: coverage(ONE, FIELD, reach_m=0.0), "above 0"),
        (lambda: coverage(ONE, FIELD, reach_m=np.nan), "above 0"),
        (lambda: coverage(ONE, FIELD, reach_m=np.ones(2)), "one number or 1"),
        (lambda: coverage(ONE, FIELD, reach_m=1.0, times=0), "1 or more"),
        (lambda: coverage(ONE, SPACE, reach_m=1.0), "2 dimensions in a region of 3"),
        (lambda: count_cells(ONE, FIELD, reach_m=1.0, cell_m=1e-4), "at most"),
        (lambda: count_cells(ONE, FIELD, reach_m=1.0, cell_m=0.0), "at most"),
        (lambda: holes(ONE, FIELD, reach_m=1.0, times=2), "number of nodes"),
    ],
)
def test_what_cannot_be_measured_is_refused(call, words):
    with pytest.raises(InputError, match=words):
        call()
