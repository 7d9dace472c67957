"""Regions and rasters: what is inside, which cell counts, and where cells stand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from trackfield.raster import Raster, Region, cell_centres, value_at

REGION = Region(-2.0, 1.0, 4.0, 5.0)


def test_the_border_is_inside():
    places = np.array([[-2.0, 1.0], [4.0, 5.0], [4.1, 3.0], [0.0, 0.9]])
    assert REGION.contains(places).tolist() == [True, True, False, False]
    assert REGION.area == 24.0


@given(st.floats(0.3, 3.0))
def test_centres_stand_in_their_own_cells_row_by_row(cell_m):
    centres, (rows, columns) = cell_centres(REGION, cell_m)
    raster = Raster(REGION, np.arange(rows * columns, dtype=float).reshape(rows, columns))
    assert_allclose(raster.at(centres), np.arange(rows * columns))
    assert_allclose(raster.centres(), centres)
    assert REGION.contains(centres).all()
    width, height = 6.0 / columns, 4.0 / rows
    assert 0.5 * cell_m <= width <= 2.0 * cell_m
    assert 0.5 * cell_m <= height <= 2.0 * cell_m


def test_rows_go_north_and_columns_east():
    raster = Raster(REGION, np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]))
    assert_allclose(raster.at(np.array([[[-1.0, 2.0], [3.0, 2.0]], [[-1.0, 4.0], [3.0, 4.0]]])),
                    [[1.0, 3.0], [4.0, 6.0]])  # fmt: skip


def test_outside_the_nearest_cell_counts():
    raster = Raster(REGION, np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]))
    assert_allclose(raster.at(np.array([[-50.0, 0.0], [1.0, 99.0], [99.0, 99.0]])), [1.0, 5.0, 6.0])


def test_a_number_is_the_same_everywhere():
    assert_allclose(value_at(0.25, np.zeros((3, 2))), 0.25)
    raster = Raster(REGION, np.array([[1.0, 2.0]]))
    assert value_at(raster, np.array([0.0, 2.0])) == 1.0
    assert raster.mean() == pytest.approx(1.5)
