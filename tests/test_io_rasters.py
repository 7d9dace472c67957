"""Maps as files: what is read back is what was written, and polygons lie on the Earth."""

import csv
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackfield.errors import InputError
from trackfield.io.geodesy import to_local
from trackfield.io.rasters import write_rasters
from trackfield.network.site import Origin
from trackfield.raster import Raster, Region

REGION = Region(-2.0, 1.0, 4.0, 5.0)
VALUES = np.array([[0.123456789, 20.0, 1e-9], [np.nan, -4e7 / 3, 0.0]])
MAPS = {
    "rms_m": Raster(REGION, VALUES),
    "covered": Raster(REGION, np.arange(6.0).reshape(2, 3)),
}
ORIGIN = Origin(lat=46.9, lon=7.4, rotation_deg=30.0)
TOLD = [0.123457, 20.0, 1e-9, np.nan, -13333300.0, 0.0]


def test_a_table_has_a_row_a_cell_from_the_south_west(tmp_path):
    path = tmp_path / "map.csv"
    write_rasters(path, MAPS)
    rows = list(csv.DictReader(path.read_text().splitlines()))
    assert list(rows[0]) == ["x_m", "y_m", "rms_m", "covered"]
    places = [(float(row["x_m"]), float(row["y_m"])) for row in rows]
    assert places == [(-1, 2), (1, 2), (3, 2), (-1, 4), (1, 4), (3, 4)]
    assert [row["covered"] for row in rows] == list("012345")
    told = [float(row["rms_m"] or "nan") for row in rows]
    np.testing.assert_allclose(told, TOLD, rtol=1e-12)
    assert rows[3]["rms_m"] == ""


def test_polygons_are_the_cells_on_the_earth(tmp_path):
    path = tmp_path / "map.geojson"
    write_rasters(path, MAPS, origin=ORIGIN)
    features = json.loads(path.read_text())["features"]
    assert [f["properties"]["covered"] for f in features] == list(range(6))
    assert features[3]["properties"]["rms_m"] is None
    for feature, centre in zip(features, MAPS["rms_m"].centres(), strict=True):
        assert feature["geometry"]["type"] == "Polygon"
        (ring,) = feature["geometry"]["coordinates"]
        assert ring[0] == ring[-1]
        corners = to_local(np.column_stack([ring, np.full(5, np.nan)]), ORIGIN)[:, :2]
        expected = centre + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
        np.testing.assert_allclose(corners, expected, atol=2e-4)


def test_a_map_of_many_cells_is_one_collection(tmp_path):
    path = tmp_path / "map.geojson"
    values = np.random.default_rng(0).uniform(0, 1, (70, 80))
    write_rasters(path, {"a": Raster(REGION, values)}, origin=ORIGIN)
    features = json.loads(path.read_text())["features"]
    found = [feature["properties"]["a"] for feature in features]
    np.testing.assert_allclose(found, values.ravel(), rtol=1e-5)


@given(st.lists(st.floats(-1e30, 1e30) | st.just(np.nan), min_size=1, max_size=6))
def test_values_keep_six_digits(tmp_path_factory, values):
    path = tmp_path_factory.mktemp("maps") / "map.ndjson"
    write_rasters(path, {"a": Raster(REGION, np.array([values]))})
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    found = [np.nan if row["a"] is None else row["a"] for row in rows]
    np.testing.assert_allclose(found, values, rtol=5.1e-6, atol=1e-300)


def test_geojson_needs_an_origin_and_nothing_is_left_behind(tmp_path):
    with pytest.raises(InputError, match="site without origin, expected"):
        write_rasters(tmp_path / "map.geojson", MAPS)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("maps", "words"),
    [
        ({}, "maps of 0 regions"),
        ({**MAPS, "b": Raster(REGION, np.zeros((3, 2)))}, "maps of 2 regions or grids"),
        ({"b": Raster(REGION, np.array([[np.inf]]))}, "'b': found an infinite value"),
    ],
)
def test_maps_that_do_not_fit_are_refused(tmp_path, maps, words):
    with pytest.raises(InputError, match=words):
        write_rasters(tmp_path / "map.csv", maps)
    with pytest.raises(InputError, match=r"suffix '\.txt'"):
        write_rasters(tmp_path / "map.txt", MAPS)
    assert not list(tmp_path.iterdir())


def test_a_place_that_cannot_be_written_is_told(tmp_path):
    with pytest.raises(InputError, match="found no folder"):
        write_rasters(tmp_path / "none" / "map.geojson", MAPS, origin=ORIGIN)
