"""Maps of accuracy as figures: what they hold, also where nothing is known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.collections import EllipseCollection
from matplotlib.image import AxesImage

from trackfield.network.site import Site
from trackfield.plotting.plans import contour_levels, plot_map
from trackfield.plotting.style import save
from trackfield.raster import Region
from trackfield.scheduling.accuracy import accuracy_map
from trackfield.sensing.range import RangeModel

REGION = Region(-2.0, -2.0, 14.0, 10.0)
PLACES = np.array([[0.0, 0.0, np.nan], [10.0, 0.0, np.nan], [5.0, 8.0, np.nan]])


def mapped(n=3, region=REGION, **model):
    names = tuple("ABC"[:n])
    site = Site("yard", names, PLACES[:n], (RangeModel(sigma_m=0.2, **model),) * n)
    return accuracy_map(site, region, cell_m=0.5)


def texts(axes):
    return {text.get_text() for text in axes.texts}


def test_a_map_shows_errors_contours_ellipses_and_sensors_and_hatches_the_rest(tmp_path):
    found = mapped(max_range_m=9.0)
    figure = plot_map(found, PLACES[:, :2], names=("A", "B", "C"), title="yard")
    axes, bar = figure.axes
    image = next(one for one in axes.get_children() if isinstance(one, AxesImage))
    shown = image.get_array()
    np.testing.assert_array_equal(np.ma.getmaskarray(shown), found.determined.values == 0.0)
    there = found.determined.values > 0.0
    assert 0 < there.sum() < there.size
    np.testing.assert_allclose(shown[there], found.rms_m.values[there])
    assert image.get_extent() == [-2.0, 14.0, -2.0, 10.0]
    assert bar.get_ylabel() == "rms error of a position [m]"
    assert {"A", "B", "C"} <= texts(axes)
    assert any(text.endswith(" m") for text in texts(axes))
    told = [text.get_text() for text in axes.get_legend().get_texts()]
    assert told[:2] == ["sensors", "no position follows"]
    (ellipses,) = (c for c in axes.collections if isinstance(c, EllipseCollection))
    factor = float(told[2].removeprefix("standard deviations x "))
    centres = np.asarray(ellipses.get_offsets())
    sizes = 2.0 * factor * found.minor_m.at(centres)
    np.testing.assert_allclose(ellipses.get_heights(), sizes)
    assert axes.get_title() == "yard"
    save(figure, tmp_path / "map.png")
    assert (tmp_path / "map.png").stat().st_size > 10_000


def test_where_a_position_follows_everywhere_nothing_is_hatched():
    axes = plot_map(mapped(), PLACES[:, :2]).axes[0]
    told = [text.get_text() for text in axes.get_legend().get_texts()]
    assert "no position follows" not in told


def test_where_none_follows_the_map_is_hatched_and_has_no_colours():
    figure = plot_map(mapped(n=1), PLACES[:1, :2])
    (axes,) = figure.axes
    assert [text.get_text() for text in axes.get_legend().get_texts()] == [
        "sensors",
        "no position follows",
    ]


@pytest.mark.parametrize(
    "region", [Region(0.0, 3.0, 0.4, 9.0), Region(2.0, 3.0, 8.0, 3.4), Region(4.0, 3.0, 4.3, 3.3)]
)
def test_a_map_of_one_row_or_column_can_be_drawn(region, tmp_path):
    save(plot_map(mapped(region=region), PLACES[:, :2]), tmp_path / "map.png")


def test_many_sensors_are_dots_without_names():
    places = np.random.default_rng(0).uniform(0, 10, (600, 2))
    axes = plot_map(mapped(), places, names=tuple(map(str, range(600)))).axes[0]
    assert "17" not in texts(axes)
    assert axes.get_lines()[0].get_markersize() == 1.0


@given(st.lists(st.floats(1e-6, 1e6), min_size=1, max_size=50))
def test_levels_are_round_few_and_within_the_values(values):
    levels = contour_levels(np.array(values))
    assert len(levels) <= 7
    assert levels == sorted(set(levels))
    for level in levels:
        assert min(values) < level < max(values)
        digits = f"{level:.6e}".split("e")[0].rstrip("0").rstrip(".")
        assert digits in {"1", "1.5", "2", "3", "4", "5", "6", "8"}


def test_levels_by_hand():
    assert contour_levels(np.linspace(0.08, 1.5, 1000)) == [0.1, 0.2, 0.5, 1.0]
    assert contour_levels(np.linspace(0.07, 0.19, 1000)) == [0.08, 0.1, 0.15]
    assert contour_levels(np.array([0.31, 0.39])) == []
