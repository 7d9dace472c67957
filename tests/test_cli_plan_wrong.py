"""`trackfield plan` with what cannot be: told in a line, and no number that would mislead."""

import json

import pytest

import cli_runs

MODEL = """
[site]
name = "yard"
[models.m]
kind = "range"
bias_m = 0
scale = 0
sigma_m = 0.1
max_range_m = 8
[reports]
region = [0, 0, 12, 10]
[robot]
comm_m = 10
max_speed_m_s = 2
"""
CORNERS = ((1.0, 1.0), (11.0, 1.0), (11.0, 9.0), (1.0, 9.0), (6.0, 5.0))
LINE = tuple((float(x), 5.0) for x in range(1, 12, 2))


def field(path, places=CORNERS, *, model=MODEL, z=None, more=""):
    rise = "" if z is None else "z_m = {z}\n"
    rows = [
        f'[[sensors]]\nsensor_id = "s{i}"\nx_m = {x}\ny_m = {y}\n' + rise.format(z=z)
        for i, (x, y) in enumerate(places)
    ]
    path.write_text(model + "".join(rows) + more)
    return path


@pytest.fixture
def call(capsys):
    return cli_runs.caller(capsys)


@pytest.fixture
def site(tmp_path):
    return field(tmp_path / "site.toml")


def walk(path, *places):
    rows = [f"{t},walker,{x},{y}\n" for t, (x, y) in enumerate(places)]
    path.write_text("t_s,target_id,x_m,y_m\n" + "".join(rows))
    return path


@pytest.mark.parametrize(
    ("question", "said"),
    [
        (("--at", "1e300,3"), "--at: found '1e300,3', expected X,Y in metres, up to 1e+09 each"),
        (("--at", "1,3", "--velocity", "nan,0"), "expected X,Y in m/s, up to 1e+09 each"),
        (("--map", "map.csv", "--plot", "a.png"), "found --map and --plot, expected one of them"),
        (("--map", "map.foo"), "for a table one of .csv, .ndjson, .parquet, .geojson"),
        (("--lifetime", "-k", 9), "--sensors: found 9, expected 1 to 4 with --lifetime"),
    ],
)
def test_questions_without_an_answer_are_refused_in_a_line(call, site, question, said):
    done = call("plan", site, *question)
    assert done.code == 2
    assert said in done.err
    assert len(done.err.splitlines()) == 1


@pytest.mark.parametrize("rms_m", ["1e300", "1e-300"])
def test_absurd_errors_are_counted_for(call, site, rms_m, monkeypatch):
    monkeypatch.setattr("trackfield.cli.plan_count._MOST", 40)
    done = call("plan", site, "--rms", rms_m, "--json")
    assert done.json["enough"] == (rms_m == "1e300")
    assert done.code == (rms_m != "1e300")


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("x_m = 6.0", "x_m = 1e300", "sensors[5].x_m: found 1e+300"),
        ("[0, 0, 12, 10]", "[0, 0, 1e300, 10]", "reports.region: found a list"),
    ],
)
def test_places_beyond_all_arithmetic_are_refused_by_key(call, site, old, new, key):
    site.write_text(site.read_text().replace(old, new))
    done = call("plan", site)
    assert done.code == 2
    assert f"site.toml: {key}, expected" in done.err
    assert "from -1e9 to 1e9" in done.err


@pytest.mark.parametrize("question", ["--robot", "--truth"])
def test_a_target_beyond_all_arithmetic_is_refused(call, site, tmp_path, question):
    truth = walk(tmp_path / "truth.csv", (1, 5), (1e300, 5))
    done = call("plan", site, *(["--lifetime"] if question == "--truth" else []), question, truth)
    assert done.code == 2
    assert "truth.csv: found 1e+300 m, expected coordinates up to 1e+09 m" in done.err


def test_targets_in_space_need_heights_and_are_not_planned_for_in_the_plane(call, tmp_path):
    space = MODEL + "[target]\ndimensions = 3\n"
    site = field(tmp_path / "site.toml", model=space, z=2.0)
    for question in ((), ("--rms", 0.1), ("--map", tmp_path / "map.csv")):
        done = call("plan", site, *question)
        assert done.code == 2
        assert "target.dimensions: found 3, expected 2" in done.err
    truth = walk(tmp_path / "truth.csv", (1, 5), (2, 5))
    flat = call("plan", site, "--lifetime", "--truth", truth)
    assert flat.code == 2
    assert "truth.csv: z_m: found nothing, expected heights" in flat.err


def test_sensors_in_one_line_do_not_tell_the_side(call, tmp_path):
    site = field(tmp_path / "site.toml", LINE)
    for question in ((), ("--at", "4,7"), ("--map", tmp_path / "map.csv")):
        assert "in one line: no reading tells a place from its mirror" in (
            call("plan", site, *question).err
        )
    bent = field(tmp_path / "bent.toml", [*LINE, (6.0, 5.2)])
    assert "mirror" not in call("plan", bent).err
    bearing = '[models.m]\nkind = "bearing"\nmax_range_m = 8\n[reports]\nregion = [0, 0, 12, 10]\n'
    turned = field(tmp_path / "turned.toml", LINE, model=bearing)
    assert "mirror" not in call("plan", turned).err


def test_readings_that_do_not_change_with_the_place_are_not_too_few(call, tmp_path):
    model = MODEL.replace('kind = "range"\nbias_m = 0\nscale = 0\nsigma_m = 0.1', "").replace(
        "[models.m]", '[models.m]\nkind = "angular_rate"\nsigma_rad_s = 0.05'
    )
    done = call("plan", field(tmp_path / "site.toml", model=model))
    assert "no position follows in 100 % of the region" in done.err
    assert "readings that do not change with the place" in done.err


@pytest.mark.parametrize(
    ("polygon", "said"),
    [
        ([[3, 3], [4, 4], [5, 5]], "without an area"),
        ([[3, 5], [5, 7], [5, 5], [3, 8]], "cross"),
    ],
)
def test_an_obstacle_that_is_no_polygon_is_named(call, tmp_path, polygon, said):
    more = "[[obstacles]]\npolygon = [[8, 8], [9, 8], [9, 9]]\n"
    more += f"[[obstacles]]\npolygon = {json.dumps(polygon)}\n"
    site = field(tmp_path / "site.toml", more=more)
    done = call("plan", site, "--robot", walk(tmp_path / "truth.csv", (1, 5), (2, 5)))
    assert done.code == 2
    assert "site yard: obstacles[2].polygon: a polygon" in done.err
    assert said in done.err


def test_a_way_that_lost_the_hop_is_not_compared_with_the_shortest(call, site, tmp_path):
    truth = walk(tmp_path / "truth.csv", (1, 5), (3, 5), (5, 5), (7, 5), (9, 5))
    rows = [line.split() for line in call("plan", site, "--robot", truth).out.splitlines()]
    assert next(row[-1] for row in rows if row[:1] == ["shortest"]) == "1.000"
    site.write_text(site.read_text().replace("max_speed_m_s = 2", "max_speed_m_s = 0.1"))
    done = call("plan", site, "--robot", truth)
    assert done.code == 1
    rows = [line.split() for line in done.out.splitlines()]
    assert [row[-1] for row in rows if row[:1] in (["looking"], ["rule"])] == ["-", "-"]


def test_lives_of_few_sensors_are_simulated_to_their_end(call, site):
    told = call("plan", site, "--lifetime", "--bound", 0.05, "--json").json
    assert told["failed_whatever_batteries"] > 0
    assert told["intervals"]["first_death"] is not None
    assert told["simulated_sensings"] == 40 * 3 * 25 / 5


def test_batteries_that_outlast_the_simulation_are_not_told_as_immortal(call, site, tmp_path):
    truth = tmp_path / "truth.csv"
    row = "{},walker,{},{}\n"
    inside = row.format(0, 6, 4)
    outside = "".join(row.format(t, 900, 900) for t in range(1, 500))
    truth.write_text("t_s,target_id,x_m,y_m\n" + inside + outside)
    done = call("plan", site, "--lifetime", "--truth", truth, "--json")
    assert done.json["intervals"]["first_death"] is None
    assert "no battery was empty after the passes that were simulated" in done.err
