"""A run as an animation: one HTML file that needs nothing else, or a GIF."""

# Matplotlib's own types leave keyword arguments unknown.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

import html
import json
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from trackfield.errors import InputError
from trackfield.plotting.many import NOTHING, Scenery, colour_of
from trackfield.plotting.style import GREY, PALETTE, SIGMAS_95, frame_map, new_figure
from trackfield.raster import Region
from trackfield.types import Matrix, Status, Tracks, Vector

TRAIL = 20  # steps of the past that are drawn behind a track
_WAIT_MS = 100  # between frames, at speed 1
_GIF_FRAMES = 300  # at most: the steps are thinned


def animation_html(tracks: Tracks, scenery: Scenery = NOTHING, *, title: str = "") -> str:
    """Make a page that plays the shown rows of tracks, with truth, reports and sensors if given.

    The page holds all data, coordinates to a millimetre, and loads nothing.
    """
    times = _times(tracks)
    box = _box(tracks, scenery)
    data = {
        "times": times.tolist(),
        "digits": _digits(times),
        "box": [round(side, 3) for side in box],
        "sensors": [] if scenery.sensors is None else _rounded(scenery.sensors),
        "tracks": _track_frames(tracks, times),
        "truth": _truth_frames(scenery, times),
        "reports": _report_frames(scenery, times),
        "palette": PALETTE,
        "trail": TRAIL,
        "wait": _WAIT_MS,
    }
    # A name that holds "</script>" must not end the script.
    text = json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
    page = files("trackfield.plotting").joinpath("player.html").read_text(encoding="utf-8")
    return page.replace("{{title}}", html.escape(title or "Tracks")).replace("{{data}}", text)


def save_animation(
    tracks: Tracks,
    path: str | Path,
    *,
    scenery: Scenery = NOTHING,
    title: str = "",
) -> None:
    """Write an animation, whole or not at all: `.html` or `.gif`, `InputError` for others."""
    path = Path(path)
    kind = animation_kind(path)
    part = path.with_name(f".{path.stem}.part{path.suffix}")  # the writer goes by the suffix
    try:
        if kind == "html":
            part.write_text(animation_html(tracks, scenery, title=title), encoding="utf-8")
        else:
            _write_gif(tracks, part, scenery=scenery, title=title)
        part.replace(path)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None


def animation_kind(path: Path) -> str:
    """Kind of animation that the suffix of `path` says; `InputError` if there is none such."""
    kind = path.suffix.removeprefix(".").lower()
    if kind not in ("html", "gif"):
        raise InputError(f"{path}: found suffix {path.suffix!r}, expected .html or .gif")
    return kind


def _times(tracks: Tracks) -> Vector:
    if not len(tracks):
        raise InputError("found no rows of tracks, expected at least one to animate")
    return np.unique(tracks.t_s)


def _digits(times: Vector) -> int:
    """How many digits tell the steps apart."""
    steps = np.diff(times)
    smallest = float(steps.min()) if steps.size else 1.0
    return int(np.clip(np.ceil(-np.log10(smallest)), 0, 6))


def _box(tracks: Tracks, scenery: Scenery) -> Region:
    """Find what the picture must hold: the region, or else everything that is drawn."""
    if scenery.region is not None:
        return scenery.region
    parts = [tracks.position[:, :2]]
    parts += [] if scenery.truth is None else [scenery.truth.position[:, :2]]
    parts += [] if scenery.sensors is None else [scenery.sensors]
    every = np.concatenate(parts)
    low, high = np.nanmin(every, axis=0), np.nanmax(every, axis=0)
    margin = 0.05 * float(max(*(high - low), 1.0))
    return Region(
        float(low[0]) - margin,
        float(low[1]) - margin,
        float(high[0]) + margin,
        float(high[1]) + margin,
    )


def _shown(tracks: Tracks) -> NDArray[np.bool_]:
    return (tracks.status == Status.CONFIRMED) | (tracks.status == Status.COASTING)


def _track_frames(tracks: Tracks, times: Vector) -> list[list[list[float]]]:
    """Shown tracks of each frame: number, place, half axes and turn of the 95 % ellipse."""
    rows = np.flatnonzero(_shown(tracks))
    xx, xy, yy = tracks.covariance[rows].T
    middle, half = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    axes = SIGMAS_95 * np.sqrt(np.maximum([middle + half, middle - half], 0.0))
    turn = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    columns = np.column_stack([tracks.position[rows, :2], axes.T, turn])
    frames: list[list[list[float]]] = [[] for _ in times]
    places = np.searchsorted(times, tracks.t_s[rows])
    for place, number, numbers in zip(
        places.tolist(), tracks.track[rows].tolist(), columns.tolist(), strict=True
    ):
        frames[place].append([number, *(round(value, 3) for value in numbers)])
    return frames


def _truth_frames(scenery: Scenery, times: Vector) -> list[list[list[float]]]:
    """Targets of each frame, number and place: those of the nearest time of the truth."""
    truth = scenery.truth
    if truth is None:
        return []
    frames: list[list[list[float]]] = [[] for _ in times]
    place = _nearest(times, truth.t_s)
    numbers = truth.target + 1
    for i in np.flatnonzero(place >= 0).tolist():
        x, y = truth.position[i, :2].tolist()
        frames[int(place[i])].append([int(numbers[i]), round(x, 3), round(y, 3)])
    return frames


def _report_frames(scenery: Scenery, times: Vector) -> list[list[float]]:
    reports = scenery.reports
    if reports is None:
        return []
    frames: list[list[float]] = [[] for _ in times]
    place = _nearest(times, reports.t_s)
    for i in np.flatnonzero(place >= 0).tolist():
        frames[int(place[i])] += _rounded(reports.position[i, :2])
    return frames


def _nearest(times: Vector, t_s: Vector) -> NDArray[np.intp]:
    """Frame (n,) whose time is nearest to each of `t_s`, -1 where none is within half a step."""
    right = np.clip(np.searchsorted(times, t_s), 1, max(times.size - 1, 1))
    left = right - 1
    right = np.minimum(right, times.size - 1)
    place = np.where(np.abs(times[left] - t_s) <= np.abs(times[right] - t_s), left, right)
    steps = np.diff(times)
    half = 0.5 * float(np.median(steps)) if steps.size else 0.5
    return np.where(np.abs(times[place] - t_s) <= half * (1 + 1e-9), place, -1)


def _rounded(values: Matrix) -> list[float]:
    return [round(value, 3) for value in np.ravel(values).tolist()]


def _write_gif(tracks: Tracks, path: Path, *, scenery: Scenery, title: str) -> None:
    from matplotlib.animation import PillowWriter

    times = _times(tracks)
    frames, truth = _track_frames(tracks, times), _truth_frames(scenery, times)
    reports = _report_frames(scenery, times)
    box = _box(tracks, scenery)
    figure = new_figure(5.6, 5.8)
    axes = figure.add_subplot()
    writer = PillowWriter(fps=10)
    step = -(-times.size // _GIF_FRAMES)
    with writer.saving(figure, path, dpi=80):
        for i in range(0, times.size, step):
            axes.clear()
            frame_map(axes, f"{title}  t = {times[i]:.{_digits(times)}f} s".strip())
            axes.set(xlim=(box.x_min, box.x_max), ylim=(box.y_min, box.y_max))
            if reports and reports[i]:
                axes.plot(reports[i][::2], reports[i][1::2], ".", color="0.6", markersize=4)
            _plot_rings(axes, truth[i] if truth else [])
            for back in range(min(TRAIL, i), -1, -1):
                _plot_dots(axes, frames[i - back], small=back > 0)
            writer.grab_frame()


def _plot_rings(axes: Axes, targets: Sequence[Sequence[float]]) -> None:
    for _, x, y in targets:
        axes.plot(x, y, "o", color=GREY, markerfacecolor="none", markersize=10)


def _plot_dots(axes: Axes, tracks: Sequence[Sequence[float]], *, small: bool) -> None:
    for number, x, y, *_ in tracks:
        colour = colour_of(int(number))
        axes.plot(x, y, "o", color=colour, markersize=1.5 if small else 5)
