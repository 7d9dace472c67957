"""Figures: what they hold, and that nothing is written where it cannot be."""

import math
from dataclasses import replace

import numpy as np
import pytest

from trackfield.errors import InputError
from trackfield.network.site import Site
from trackfield.sensing.range import RangeModel
from trackfield.types import Readings, Status, Tracks, Truth

pytest.importorskip("matplotlib")

from matplotlib.collections import EllipseCollection

from trackfield.calibration.ranges import calibrate
from trackfield.plotting.calibration import plot_calibration
from trackfield.plotting.style import PALETTE, SIGMAS_95, kind_of, save
from trackfield.plotting.tagged import Course, Errors, plot_tracks

SITE = Site(
    "yard",
    ("A", "B", "C"),
    np.array([[0.0, 0, np.nan], [30, 0, np.nan], [0, 20, np.nan]]),
    (RangeModel(),) * 3,
)


def make_tracks(names=("tag",), n=200, gap_s=60.0):
    t = np.arange(n) * 0.5
    t[n // 2 :] += gap_s
    t = np.tile(t, len(names))
    target = np.repeat(np.arange(len(names)), n).astype(np.int32)
    rows = t.size
    return Tracks(
        t_s=t,
        track=target + 1,
        position=np.column_stack(
            [10 + np.sin(t / 9), 8 + 0.02 * t + target, np.full(rows, np.nan)]
        ),
        velocity=np.zeros((rows, 3)),
        covariance=np.tile([0.5, 0.2, 0.3], (rows, 1)),
        status=np.full(rows, Status.CONFIRMED, np.int32),
        target=target,
        nis=np.full(rows, 1.5),
        target_ids=tuple(names),
    )


def lines(axes):
    return {line.get_label(): line for line in axes.get_lines()}


def test_the_map_holds_sensors_truth_track_and_honest_ellipses():
    tracks = make_tracks()
    truth = Truth(tracks.t_s, tracks.target, tracks.position, ("tag",))
    place = plot_tracks(SITE, tracks, truth=truth).axes[0]
    found = lines(place)
    assert {"sensor", "truth", "track", "95 % ellipse"} <= set(found)
    np.testing.assert_array_equal(found["sensor"].get_xydata(), SITE.positions[:, :2])
    assert place.get_aspect() == 1.0
    (ellipses,) = (c for c in place.collections if isinstance(c, EllipseCollection))
    values, vectors = np.linalg.eigh([[0.5, 0.2], [0.2, 0.3]])
    np.testing.assert_allclose(ellipses.get_widths(), 2 * SIGMAS_95 * math.sqrt(values[1]))
    np.testing.assert_allclose(ellipses.get_heights(), 2 * SIGMAS_95 * math.sqrt(values[0]))
    turn = np.degrees(math.atan2(vectors[1, 1], vectors[0, 1])) % 180
    np.testing.assert_allclose(ellipses.get_angles() % 180, turn)


def test_lines_are_broken_where_nothing_was_known():
    x = lines(plot_tracks(SITE, make_tracks()).axes[0])["track"].get_xdata()
    assert np.flatnonzero(np.isnan(x)).tolist() == [100]


def test_errors_are_drawn_below_their_bound_with_units():
    tracks = make_tracks()
    errors = Errors(np.arange(200), np.column_stack([np.full(200, 0.3), np.full(200, 0.4)]))
    axes = plot_tracks(SITE, tracks, errors=errors).axes
    np.testing.assert_allclose(lines(axes[1])["error"].get_ydata()[:100], 0.5)
    bound = SIGMAS_95 * math.sqrt(np.linalg.eigvalsh([[0.5, 0.2], [0.2, 0.3]])[1])
    outline = np.vstack([p.vertices for c in axes[1].collections for p in c.get_paths()])
    assert outline[:, 1].max() == pytest.approx(bound)
    assert [a.get_ylabel() for a in axes] == [
        "y, north [m]",
        "position error [m]",
        "NIS, clipped at 9",
    ]
    assert axes[2].get_xlabel() == "time [s]"


def test_tracks_without_innovations_have_no_panel_for_them():
    tracks = make_tracks()
    without = replace(tracks, nis=np.full(len(tracks), np.nan))
    axes = plot_tracks(SITE, without).axes
    assert [a.get_xlabel() for a in axes] == ["x, east [m]", "time [s]"]
    assert len(plot_tracks(SITE, tracks).axes) == 3


def test_innovations_are_averaged():
    found = lines(plot_tracks(SITE, make_tracks()).axes[2])["mean"].get_ydata()
    np.testing.assert_allclose(found[~np.isnan(found)], 1.5)


def test_several_targets_have_names_and_colours_of_their_own():
    found = lines(plot_tracks(SITE, make_tracks(("a", "b"))).axes[0])
    assert {"track of a", "track of b"} <= set(found)
    assert [found[f"track of {n}"].get_color() for n in "ab"] == list(PALETTE[:2])


def test_tracks_without_a_shown_row_are_drawn_as_nothing():
    tracks = make_tracks()
    tracks.status[:] = Status.TENTATIVE
    assert lines(plot_tracks(SITE, tracks).axes[0])["track"].get_xdata().size == 0


def make_calibration():
    rng = np.random.default_rng(0)
    n = 600
    t = np.arange(n) * 0.1
    place = np.column_stack([12 + 8 * np.sin(t / 7), 9 + 6 * np.cos(t / 5), np.full(n, np.nan)])
    sensor = np.arange(n, dtype=np.int32) % 3
    r = np.linalg.norm(place[:, :2] - SITE.positions[sensor, :2], axis=1)
    readings = Readings(
        t_s=t,
        sensor=sensor,
        value=1.05 * r + 0.2 + 0.1 * rng.standard_normal(n),
        target=np.zeros(n, np.int32),
        kind=np.zeros(n, np.int32),
        sigma=np.full(n, np.nan),
        arrival_s=np.full(n, np.nan),
        sensor_ids=SITE.sensor_ids,
        target_ids=("tag",),
        kinds=("range",),
    )
    return calibrate(SITE, readings, Truth(t, np.zeros(n, np.int32), place, ("tag",)))


def test_a_calibration_shows_errors_before_and_after():
    before, after, normal, spread = plot_calibration(
        make_calibration(), target_ids=("tag",), title="yard"
    ).axes
    cloud = lines(before)["A"].get_xydata()
    slope, height = np.polyfit(cloud[:, 0], cloud[:, 1], 1)
    assert (slope, height) == (pytest.approx(0.05, abs=0.005), pytest.approx(0.2, abs=0.05))
    left = lines(after)["A"].get_ydata()
    assert np.std(left) == pytest.approx(0.1, abs=0.015)
    assert abs(np.mean(left)) < 0.03
    scaled = lines(normal)["residuals"].get_xydata()
    middle = np.abs(scaled[:, 0]) < 2
    slope = np.polyfit(scaled[middle, 0], scaled[middle, 1], 1)[0]
    assert slope == pytest.approx(1.0, abs=0.15)
    assert [tick.get_text() for tick in spread.get_xticklabels()] == [f"{n}\n200" for n in "ABC"]
    for axes in (before, after):
        assert axes.get_xlabel() == "true distance [m]"


def test_figures_are_written_whole_in_the_kind_of_their_suffix(tmp_path):
    figure = plot_tracks(SITE, make_tracks())
    save(figure, tmp_path / "a.png")
    save(figure, tmp_path / "a.SVG")
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    assert b"<svg" in (tmp_path / "a.SVG").read_bytes()
    assert len(list(tmp_path.iterdir())) == 2


def test_a_figure_that_cannot_be_written_leaves_nothing(tmp_path):
    with pytest.raises(InputError, match=r"found suffix '\.xyz', expected one of .*\.png"):
        kind_of(tmp_path / "a.xyz")
    with pytest.raises(InputError, match="cannot be written"):
        save(plot_tracks(SITE, make_tracks()), tmp_path / "absent" / "a.png")
    (tmp_path / "a.png").mkdir()
    with pytest.raises(InputError, match="cannot be written"):
        save(plot_tracks(SITE, make_tracks()), tmp_path / "a.png")
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]


def test_of_overlapping_ellipses_the_small_ones_are_drawn():
    tracks = make_tracks()
    wide = np.tile([90.0, 0.0, 90.0], (len(tracks), 1))
    wide[:: len(tracks) - 1] = 0.01, 0.0, 0.01
    place = plot_tracks(SITE, replace(tracks, covariance=wide)).axes[0]
    (ellipses,) = (c for c in place.collections if isinstance(c, EllipseCollection))
    widths = sorted(ellipses.get_widths())
    assert len(widths) < 10  # of forty
    np.testing.assert_allclose(widths[:2], 2 * SIGMAS_95 * 0.1)


def test_courses_are_the_fainter_the_less_likely():
    ends = np.array([[0.0, 0.0], [10.0, 5.0]])
    courses = [Course(ends, 0.8), Course(-ends, 0.2)]
    place = plot_tracks(SITE, make_tracks(), courses=courses).axes[0]
    first, second = [line for line in place.get_lines() if line.get_linestyle() == "--"]
    np.testing.assert_array_equal(first.get_xydata(), ends)
    assert (first.get_label(), first.get_alpha(), second.get_alpha()) == ("trajectory", 0.8, 0.2)
