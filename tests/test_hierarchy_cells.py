"""Cells of groups: who owns a place, who hears of it, and what each group is told."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial import cKDTree

from trackfield.association.model import Reporting, Scene, Targets
from trackfield.errors import ConfigurationError
from trackfield.hierarchy.cells import OPEN_BIRTHS_PER_S, Cells
from trackfield.raster import Raster, Region, cell_centres

REGION = Region(0.0, 0.0, 100.0, 80.0)
QUARTERS = np.array([[25.0, 20.0], [75.0, 20.0], [25.0, 60.0], [75.0, 60.0]])
ODD = np.array([[10.0, 70.0], [90.0, 10.0], [40.0, 30.0], [80.0, 75.0], [55.0, 50.0]])
PLACES = np.random.default_rng(0).uniform((0, 0), (100, 80), (500, 2))
MANY, _ = cell_centres(REGION, 0.5)


def scene(**reporting):
    return Scene(
        Reporting(REGION, p_detection=(0.4, 0.8), false_per_scan=6.0, **reporting),
        Targets(births_per_s=0.2, initial_count=3.0),
    )


@pytest.mark.parametrize("centres", [QUARTERS, ODD])
def test_a_place_belongs_to_the_nearest_leader(centres):
    cells = Cells(centres)
    expected = cKDTree(centres).query(PLACES)[1]
    assert np.array_equal(cells.owner(PLACES), expected)


def test_groups_that_share_nothing_share_out_the_whole_scene():
    for centres in (QUARTERS, QUARTERS[:2]):
        cells, whole = Cells(centres), scene()
        parts = [cells.scene(g, whole, margin_m=0.0) for g in range(len(cells))]
        for total, share in (
            (6.0, [p.reporting.false_per_scan for p in parts]),
            (0.2, [p.targets.births_per_s for p in parts]),
            (3.0, [p.targets.initial_count for p in parts]),
        ):
            assert sum(share) == pytest.approx(total)


def test_groups_share_out_births_where_none_are_told():
    whole = Scene(Reporting(REGION), Targets(births_per_s=None))
    part = Cells(QUARTERS).scene(0, whole, margin_m=0.0)
    assert part.targets.births_per_s == pytest.approx(OPEN_BIRTHS_PER_S / 4)


def test_a_group_hears_of_the_box_around_its_cell_and_the_margin():
    plain = Cells(QUARTERS).scene(1, scene(), margin_m=5.0)
    assert plain.reporting.region == pytest.approx((45.0, 0.0, 100.0, 45.0), abs=1e-9)
    assert plain.reporting.p_detection == (0.4, 0.8)
    assert plain.reporting.false_per_scan == pytest.approx(6.0 * 55 * 45 / 8000)
    for group in range(len(ODD)):
        narrow = Cells(ODD).region(group, REGION, margin_m=0.0)
        own = MANY[Cells(ODD).owner(MANY) == group]
        assert narrow.contains(own).all()
        assert_allclose(narrow[:2], own.min(axis=0), atol=0.6)
        assert_allclose(narrow[2:], own.max(axis=0), atol=0.6)
        wide = Cells(ODD).region(group, REGION, margin_m=7.0)
        inside = np.clip(own + np.array([7.0, -7.0]), (0, 0), (100, 80))
        assert wide.contains(inside).all()


def test_a_part_has_its_share_of_what_is_denser_there():
    grid, shape = cell_centres(REGION, 2.0)
    density = Raster(REGION, np.where(grid[:, 0] < 50.0, 3.0, 1.0).reshape(shape))
    west, east = (Cells(QUARTERS).scene(g, scene(false_map=density), margin_m=0.0) for g in (0, 1))
    assert west.reporting.false_per_scan == pytest.approx(6.0 * 0.75 / 2)
    assert east.reporting.false_per_scan == pytest.approx(6.0 * 0.25 / 2)
    assert west.reporting.false_map is density


def test_what_is_left_open_stays_open():
    open_scene = Scene(Reporting(REGION))
    part = Cells(QUARTERS).scene(0, open_scene, margin_m=3.0)
    assert part.reporting.p_detection is None
    assert part.reporting.false_per_scan is None


def test_leaders_that_cannot_lead_are_refused():
    with pytest.raises(ConfigurationError, match="leaders at one place: 1 and 3"):
        Cells(np.array([[1.0, 1.0], [2.0, 2.0], [1.0, 1.0]]))
    with pytest.raises(ConfigurationError, match=r"shape \(0, 2\)"):
        Cells(np.zeros((0, 2)))
    with pytest.raises(ConfigurationError, match="finite"):
        Cells(np.array([[np.nan, 1.0]]))
    outside = Cells(np.array([[50.0, 40.0], [500.0, 40.0]]))
    with pytest.raises(ConfigurationError, match="group 2 without a place in the region"):
        outside.scene(1, scene(), margin_m=0.0)


def test_one_group_is_told_everything():
    assert Cells(np.array([[50.0, 40.0]])).scene(0, scene(), margin_m=0.0) == scene()
