"""Animations: the page plays in a real browser, the GIF moves."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from conftest import lacking
from many_runs import crossing, tracks_of
from trackfield.errors import InputError
from trackfield.plotting.animation import animation_html, animation_kind, save_animation
from trackfield.plotting.many import Scenery
from trackfield.raster import Region

REGION = Region(0.0, 0.0, 40.0, 40.0)


def data_of(page):
    (text,) = re.findall(r"^const run = (.*);$", page, re.MULTILINE)
    return json.loads(text)


def test_the_page_holds_every_shown_row_and_what_stands_beside_it():
    tracks, truth, reports = crossing()
    page = animation_html(tracks, Scenery(REGION, np.array([[1.0, 2.0]]), reports, truth))
    data = data_of(page)
    assert data["times"] == [float(t) for t in range(2, 20)]
    assert data["box"] == [0.0, 0.0, 40.0, 40.0]
    assert sum(map(len, data["tracks"])) == np.sum(tracks.status > 0)
    number, x, y, long, short, turn = data["tracks"][0][0]
    assert (number, x, y) == (1, 7.1, 12.1)
    # 95 % ellipse of [[.04, .01], [.01, .09]]: eigenvalues by NumPy.
    values, axes = np.linalg.eigh([[0.04, 0.01], [0.01, 0.09]])
    assert [short, long] == [round(v, 3) for v in 2.447746830680816 * np.sqrt(values)]
    assert np.tan(turn) == pytest.approx(axes[1, 1] / axes[0, 1], rel=2e-2)
    assert data["truth"][0] == [[1, 7.0, 12.0], [2, 7.0, 28.0]]
    assert data["reports"][0] == [7.0, 12.0, 7.0, 28.0]
    assert data["sensors"] == [1.0, 2.0]


def test_truth_between_frames_goes_to_the_nearest_and_beyond_them_to_none():
    tracks, truth, reports = crossing()
    shifted = replace(truth, t_s=truth.t_s + 0.25)
    data = data_of(animation_html(tracks, Scenery(None, None, reports, shifted)))
    assert [len(frame) for frame in data["truth"]] == [2] * 18
    assert data["box"][0] < 5.0 < 24.1 < data["box"][2]


def test_a_name_cannot_break_out_of_the_page():
    tracks = tracks_of([0.0], [1], [[1.0, 2.0]])
    page = animation_html(tracks, title="</script><b>&")
    assert "</script><b>" not in page
    assert "&lt;/script&gt;&lt;b&gt;&amp;" in page


def test_a_browser_plays_the_page(tmp_path):
    browser = shutil.which("chromium") or lacking("the browser chromium")
    tracks, truth, reports = crossing()
    path = tmp_path / "run.html"
    save_animation(tracks, path, scenery=Scenery(REGION, None, reports, truth), title="Crossing")
    played = path.read_text(encoding="utf-8").replace(
        "show(0);\n</script>", "show(0);\nplay.click();\n</script>"
    )
    path.write_text(played, encoding="utf-8")
    flags = "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-sync"
    quiet = "--disable-background-networking --disable-component-update"
    command = [browser, *flags.split(), *quiet.split(), f"--user-data-dir={tmp_path / 'profile'}"]
    command += ["--virtual-time-budget=8000", "--dump-dom", path.as_uri()]
    run = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    # Played to the end, where both targets are tracked, and stopped there.
    assert 'id="counts">2 tracks, 2 true<' in run.stdout
    assert re.search(r'<output id="clock">19 s</output>', run.stdout)
    assert re.search(r'aria-pressed="false">Play<', run.stdout)


def test_a_gif_has_a_frame_a_step(tmp_path):
    tracks, truth, reports = crossing(8)
    path = tmp_path / "run.gif"
    save_animation(tracks, path, scenery=Scenery(REGION, None, reports, truth))
    with Image.open(path) as image:
        assert image.n_frames == 6
    assert [p.name for p in tmp_path.iterdir()] == ["run.gif"]


def test_what_cannot_be_animated_is_said(tmp_path):
    tracks, _, _ = crossing()
    with pytest.raises(InputError, match=r"found suffix '\.mp4', expected \.html or \.gif"):
        animation_kind(tmp_path / "run.mp4")
    with pytest.raises(InputError, match="no rows of tracks"):
        animation_html(tracks_of([], [], []))
    with pytest.raises(InputError, match=r"nowhere.run\.html: cannot be written"):
        save_animation(tracks, tmp_path / "nowhere" / "run.html")
