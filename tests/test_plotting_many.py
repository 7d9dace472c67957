"""Figures of many targets and of fields: what they hold."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex
from numpy.testing import assert_allclose

from many_runs import crossing, tracks_of
from trackfield.plotting.fields import Scan, plot_detections, plot_scan
from trackfield.plotting.many import Scenery, colour_of, plot_many
from trackfield.plotting.style import save
from trackfield.raster import Raster, Region

REGION = Region(0.0, 0.0, 40.0, 40.0)


def bars(axes):
    """Colour, row, start and end of every bar of a timeline."""
    found = []
    for collection in axes.collections:
        assert isinstance(collection, LineCollection)
        colour = to_hex(collection.get_colors()[0])
        for (start, row), (end, _) in collection.get_segments():
            found.append((colour, row, start, end))
    return found


def followed_by(tracks):
    return np.select([tracks.track == 1, np.isin(tracks.track, [2, 3])], [0, 1], -1).astype(
        np.int32
    )


def test_the_timeline_shows_which_track_followed_which_target():
    tracks, truth, reports = crossing()
    scenery = Scenery(REGION, np.array([[1.0, 2.0]]), reports, truth, followed_by(tracks))
    figure = plot_many(tracks, scenery, title="crossing")
    _, timeline, counts = figure.axes
    found = bars(timeline)
    assert (to_hex("0.85"), 0.0, -0.5, 19.5) in found
    assert (colour_of(1).lower(), 0.0, 1.5, 19.5) in found
    assert (colour_of(2).lower(), 1.0, 1.5, 9.5) in found
    assert (colour_of(3).lower(), 1.0, 9.5, 19.5) in found
    assert len(found) == 5
    assert [label.get_text() for label in timeline.get_yticklabels()] == ["a", "b"]
    lines = {line.get_label(): line for line in counts.get_lines()}
    assert_allclose(lines["truth"].get_ydata(), 2.0)
    # The row that is only tentative is not counted.
    assert_allclose(lines["shown"].get_ydata(), 2.0)
    assert figure.get_suptitle() == "crossing"


def test_without_truth_the_timeline_is_of_tracks_and_thin_where_they_were_not_detected():
    tracks, _, _ = crossing()
    timeline = plot_many(tracks).axes[1]
    assert [label.get_text() for label in timeline.get_yticklabels()] == ["1", "2", "3"]
    widths = {float(c.get_linewidths()[0]) for c in timeline.collections}
    assert widths == {1.2, 3.5}
    assert not any(row > 2 for _, row, _, _ in bars(timeline))


def test_a_path_is_broken_where_a_track_was_not_shown():
    tracks = tracks_of([0, 1, 2, 9, 10], [1] * 5, np.arange(10.0).reshape(5, 2))
    paths = [line for line in plot_many(tracks).axes[0].get_lines() if line.get_xdata().size > 3]
    assert np.isnan(paths[0].get_xdata()).sum() == 1


def test_a_run_of_nothing_shown_is_drawn_empty(tmp_path):
    tracks = tracks_of([0.0], [1], [[1.0, 2.0]], status=[0])
    save(plot_many(tracks), tmp_path / "empty.png")
    assert (tmp_path / "empty.png").stat().st_size > 1000


def test_a_scan_shows_who_spoke_who_was_silent_and_what_is_likely():
    sensors = np.array([[0.0, 0.0], [5.0, 0.0], [0.0, 5.0]])
    likelihood = Raster(Region(0, 0, 10, 10), np.array([[-40.0, -2.0], [-1.0, -3.0]]))
    spots = np.array([[2.0, 2.0]])
    scan = Scan(sensors, np.array([1.0, 0.0, np.nan]), likelihood, spots, spots)
    axes = plot_scan(scan, title="now").axes[0]
    (image,) = axes.get_images()
    assert image.get_clim() == (-16.0, -1.0)
    assert axes.get_title() == "now"
    labels = {text.get_text() for text in axes.get_legend().get_texts()}
    assert labels == {"said something", "not heard", "targets", "reports"}
    assert_allclose(axes.collections[0].get_offsets(), [[0.0, 0.0]])
    bare = plot_scan(Scan(sensors, np.zeros(3))).axes[0]
    assert bare.get_legend() is None


def test_a_raster_of_detections_has_a_mark_for_each():
    axes = plot_detections(np.array([0.0, 1.5]), np.array([3, 1], np.int32), sensors=5).axes[0]
    (marks,) = axes.get_lines()
    assert_allclose(marks.get_xydata(), [[0.0, 3.0], [1.5, 1.0]])
    assert axes.get_ylim() == (-0.5, 4.5)


@pytest.mark.parametrize("number", [1, 8, 15])
def test_an_identity_has_one_colour(number):
    assert colour_of(number) == colour_of(1)
    assert colour_of(number) != colour_of(number + 1)
