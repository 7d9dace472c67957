"""`trackfield plan`: whom to ask, maps, what the field can do; faults are said in one line."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

import cli_runs
from trackfield.cli import plan_lifetime
from trackfield.errors import InputError
from trackfield.localization.information import site_gains
from trackfield.network.site_file import load_site
from trackfield.scheduling.point import plan_point

SITE = """
[site]
name = "yard"
[models.uwb]
kind = "range"
bias_m = 0
scale = 0
sigma_m = 0.1
max_range_m = 8
[reports]
region = [0, 0, 12, 10]
"""


@pytest.fixture
def call(capsys):
    return cli_runs.caller(capsys)


@pytest.fixture
def site(tmp_path):
    rng = np.random.default_rng(4)
    places = rng.uniform(0.0, 10.0, (24, 2)).round(3)
    rows = [f"s{i},{x},{y}\n" for i, (x, y) in enumerate(places.tolist())]
    (tmp_path / "sensors.csv").write_text("sensor_id,x_m,y_m\n" + "".join(rows))
    path = tmp_path / "site.toml"
    path.write_text(SITE.replace('name = "yard"', 'name = "yard"\nsensors_file = "sensors.csv"'))
    return path


def test_a_point_names_the_best_sensors_of_all_sets(call, site):
    done = call("plan", site, "--at", "5,5", "-k", 3, "--json")
    assert (done.code, done.err) == (0, "")
    told, loaded = done.json, load_site(site)
    assert len(told["sensors"]) == 3
    assert told["optimal"]
    gains = site_gains(loaded, np.array([5.0, 5.0]))
    best = min(
        np.trace(np.linalg.inv(gains[list(s)].T @ gains[list(s)]))
        for s in np.array(np.meshgrid(*[range(24)] * 3)).reshape(3, -1).T
        if s[0] < s[1] < s[2] and np.linalg.matrix_rank(gains[list(s)]) == 2
    )
    assert told["value"] == pytest.approx(best, rel=1e-9)
    assert told["rms_m"] == pytest.approx(np.sqrt(best))
    assert told["all_rms_m"] < told["rms_m"] <= told["nearest_rms_m"]


def test_a_point_is_told_in_words_and_drawn(call, site, tmp_path):
    done = call("plan", site, "--at", "5,5", "--plot", tmp_path / "choice.png")
    assert done.code == 0
    assert "sensors in reach" in done.out
    assert "rms error" in done.out
    assert (tmp_path / "choice.png").stat().st_size > 10_000


def test_a_point_that_nobody_sees_is_told_and_fails(call, site, tmp_path):
    done = call("plan", site, "--at", "40,5", "--plot", tmp_path / "none.png")
    assert done.code == 1
    assert "found 0 sensors in reach, expected 4" in done.err
    assert "no reading tells where the target is along" in done.err
    assert (tmp_path / "none.png").exists()
    told = call("plan", site, "--at", "40,5", "--json")
    assert told.code == 1
    assert told.json["rms_m"] is None
    assert told.json["all_rms_m"] is None


def test_sensors_in_line_with_the_target_leave_a_direction_free(call, tmp_path):
    path = tmp_path / "line.toml"
    rows = [f'[[sensors]]\nsensor_id = "{n}"\nx_m = {n}\ny_m = 0\n' for n in range(4)]
    path.write_text('[models.r]\nkind = "range"\n' + "".join(rows))
    done = call("plan", path, "--at", "1.5,0", "--json")
    assert done.code == 1
    assert not done.json["determined"]
    np.testing.assert_allclose(np.abs(done.json["unknown_directions"]), [[0.0, 1.0]], atol=1e-9)


def test_angular_rates_tell_of_a_target_whose_velocity_is_given(call, tmp_path):
    path = tmp_path / "rates.toml"
    rows = [
        f'[[sensors]]\nsensor_id = "{n}"\nx_m = {x}\ny_m = {y}\n'
        for n, (x, y) in enumerate([(0, 0), (9, 1), (4, 8)])
    ]
    path.write_text('[models.r]\nkind = "angular_rate"\n' + "".join(rows))
    assert call("plan", path, "--at", "4,3").code == 1
    done = call("plan", path, "--at", "4,3", "--velocity", "1,0.5", "--json")
    assert done.code == 0
    assert done.json["determined"]


def test_targets_at_a_known_height_are_farther(site):
    loaded = load_site(site)
    high = replace(
        loaded,
        target=replace(loaded.target, height_m=3.0),
        positions=np.column_stack([loaded.positions[:, :2], np.zeros(24)]),
    )
    flat, above = (plan_point(one, np.array([5.0, 5.0]), 3) for one in (loaded, high))
    assert set(above.reach) <= set(flat.reach)
    place = loaded.positions[above.reach, :2] - [5.0, 5.0]
    expected = np.hypot(np.linalg.norm(place, axis=1), 3.0)
    np.testing.assert_allclose(above.distance_m, expected)


@pytest.mark.parametrize("suffix", ["csv", "geojson", "png"])
def test_a_map_is_a_table_or_a_picture(call, site, tmp_path, suffix):
    if suffix == "geojson":
        text = site.read_text().replace('name = "yard"', 'name = "yard"\norigin = {lat=52, lon=4}')
        site.write_text(text)
    path = tmp_path / f"map.{suffix}"
    done = call("plan", site, "--map", path, "--cell", 0.5, "--json")
    assert done.code == 0
    assert done.json["cells"] == [20, 24]
    if suffix == "csv":
        with path.open() as file:
            rows = list(csv.DictReader(file))
        assert len(rows) == 480
        rms = sorted(float(row["rms_m"]) for row in rows if row["rms_m"])
        assert done.json["rms_m"]["worst"] == pytest.approx(rms[-1], rel=1e-5)
    elif suffix == "geojson":
        assert len(json.loads(path.read_text())["features"]) == 480
    else:
        assert path.stat().st_size > 10_000


def test_a_map_of_the_best_few_is_worse_than_of_all(call, site, tmp_path):
    every = call("plan", site, "--map", tmp_path / "a.csv", "--cell", 1, "--json").json
    three = call("plan", site, "--map", tmp_path / "b.csv", "--cell", 1, "-k", 3, "--json").json
    assert three["rms_m"]["median"] > 1.3 * every["rms_m"]["median"]
    assert three["readings_of"] == 3


def test_without_a_question_the_field_is_described(call, site, tmp_path):
    done = call("plan", site, "--plot", tmp_path / "field.png")
    assert done.code == 0
    assert "yard: 24 sensors, 12 x 10 m" in done.out
    assert "seen by" in done.out
    assert "days on a battery" in done.out
    told = call("plan", site, "--json").json
    assert told["coverage"]["share"] == sorted(told["coverage"]["share"], reverse=True)
    assert told["network"] is None
    assert told["steady"]["bounded"] == 1.0 - told["accuracy"]["undetermined"]
    assert told["steady"]["rms_m"]["median"] < told["accuracy"]["rms_m"]["median"]
    assert told["battery_days"]["sleeping"] > told["battery_days"]["sensing"]
    assert (tmp_path / "field.png").exists()


def test_sensors_that_no_message_leaves_are_named(call, site):
    hop = '[network]\nhop_m = 3\n[[groups]]\nid = "g"\nx_m = 2\ny_m = 2\n[energy]\nsleep_mw = 0\n'
    site.write_text(site.read_text() + hop)
    far = site.parent / "sensors.csv"
    far.write_text(far.read_text() + "alone,400,400\n")
    done = call("plan", site, "--json")
    assert "alone" in done.json["network"]["cut_off"]
    assert "without a way to their leader" in done.err
    assert done.json["battery_days"]["sleeping"] is None
    assert "for ever" in call("plan", site).out


def test_reach_without_end_has_no_coverage(call, site):
    site.write_text(site.read_text().replace("max_range_m = 8\n", ""))
    done = call("plan", site, "--json")
    assert done.code == 0
    assert done.json["coverage"] is None


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--at", "5"], "--at: found '5', expected X,Y in metres"),
        (["--at", "5,nan"], "--at: found '5,nan', expected X,Y in metres"),
        (["--at", "5,5", "--criterion", "B"], "--criterion: found 'B', expected one of A"),
        (["--at", "5,5", "--velocity", "x"], "--velocity: found 'x'"),
        (["--at", "5,5", "--map", "a.png"], "found --at and --map, expected one question"),
        (["--map", "a.xyz"], "a.xyz: found suffix '.xyz'"),
        (["--map", "a.geojson"], "found a site without origin"),
        (["--map", "a.csv", "--cell", "-1"], "--cell: found -1, expected a size above 0"),
        (["--velocity", "1,1"], "--velocity: found without --at, which it belongs to"),
        (["--at", "5,5", "--bound", "1"], "--bound: found without --lifetime"),
        (["--map", "a.csv", "--start", "1,1"], "--start: found without --robot"),
        (["--rms", "-1"], "--rms: found -1, expected an error above 0"),
        (["--rms", "1", "--layout", "round"], "--layout: found 'round', expected one of: hexa"),
        (["--rms", "1", "--at", "1,1"], "found --at and --rms, expected one question"),
        (["--plot", "site.toml"], "found suffix '.toml'"),
    ],
)
def test_wrong_usage_is_one_clear_line(call, site, monkeypatch, arguments, said):
    monkeypatch.chdir(site.parent)
    done = call("plan", site, *arguments)
    assert done.code == 2
    assert said in done.err
    assert len(done.err.splitlines()) == 1


def test_a_site_without_sensors_is_refused(call, tmp_path):
    path = tmp_path / "bare.toml"
    path.write_text("[reports]\nregion = [0, 0, 5, 5]\n")
    done = call("plan", path, "--at", "1,1")
    assert done.code == 2
    assert "found no sensors, expected some whose work is planned" in done.err
    path.write_text('[[sensors]]\nsensor_id = "a"\nx_m = 0\ny_m = 0\n')
    alone = call("plan", path)
    assert alone.code == 2
    assert "found nothing and no sensors that span a region" in alone.err


def test_a_point_of_another_size_or_nowhere_is_refused(site):
    loaded = load_site(site)
    for place in (np.zeros(3), np.array([np.nan, 1.0])):
        with pytest.raises(InputError, match="expected 2 finite coordinates"):
            plan_point(loaded, place, 3)
    bare = replace(loaded, sensor_ids=(), positions=np.empty((0, 3)), models=())
    with pytest.raises(InputError, match="found no sensors"):
        plan_point(bare, np.zeros(2), 3)


@pytest.mark.parametrize("layout", ["hexagonal", "random"])
def test_a_better_error_needs_more_nodes(call, site, tmp_path, layout):
    told = [
        call("plan", site, "--rms", rms, "--layout", layout, "--seed", 3, "--json").json
        for rms in (0.1, 0.2)
    ]
    assert told[0]["nodes"] > 1.5 * told[1]["nodes"]
    assert all(one["enough"] and one["reached_share"] >= 0.95 for one in told)
    picture = tmp_path / "nodes.png"
    done = call("plan", site, "--rms", 0.2, "--layout", layout, "--seed", 3, "--plot", picture)
    assert f"{told[1]['nodes']} nodes like s0 are enough" in done.out
    assert picture.exists()


def test_an_error_that_no_number_reaches_is_told(call, site):
    site.write_text(site.read_text().replace("max_range_m = 8", "max_range_m = 0.5"))
    done = call("plan", site, "--rms", 0.0001, "--layout", "square")
    assert done.code == 1
    assert "found no number of nodes up to" in done.err


def test_a_field_that_fixes_no_position_has_no_error_in_the_long_run(call, tmp_path):
    path = tmp_path / "two.toml"
    rows = [f'[[sensors]]\nsensor_id = "{n}"\nx_m = {n}\ny_m = {n}\n' for n in range(2)]
    model = '[models.r]\nkind = "range"\nmax_range_m = 0.5\n[reports]\nregion = [0, 0, 20, 20]\n'
    path.write_text(model + "".join(rows))
    told = call("plan", path, "--json").json
    assert told["steady"]["rms_m"] is None
    assert told["accuracy"]["rms_m"] is None
    assert "seen by" in call("plan", path).out


ROBOT = """
[network]
hop_m = 9
[[groups]]
id = "sink"
x_m = 0
y_m = 0
[robot]
sensing_m = 7
max_speed_m_s = 2
"""


@pytest.fixture
def walk(tmp_path):
    path = tmp_path / "truth.csv"
    rows = [
        f"{k / 5},{n},{k / 10},{5 + 3 * np.sin(k / 6 + n)}\n" for k in range(101) for n in (0, 1)
    ]
    path.write_text("t_s,target_id,x_m,y_m\n" + "".join(rows))
    return path


def test_a_robot_keeps_the_hop_on_a_short_way(call, site, walk, tmp_path):
    site.write_text(site.read_text() + ROBOT)
    done = call("plan", site, "--robot", walk, "--plot", tmp_path / "way.png")
    assert done.code == 0
    assert "a hop was kept in 100 % of the samples" in done.out
    told = call("plan", site, "--robot", walk, "--json").json
    assert told["target"] == "0"
    assert told["reach_m"] == 2.0
    assert told["optimum_m"] <= told["length_m"] <= told["rule_m"] + told["reach_m"]
    assert told["hops_to_sink"]["most"] >= 1
    assert len(told["path_m"]) == 101
    away = call("plan", site, "--robot", walk, "--target", "1", "--start", "1,5", "--json")
    assert away.code == 1
    assert "--start: found a place out of reach" in away.err
    assert away.json["target"] == "1"
    assert away.json["needed_speed_m_s"] is None
    assert away.json["path_m"][0] != told["path_m"][0]


def test_a_robot_that_is_too_slow_says_so_and_fails(call, site, walk):
    site.write_text(site.read_text() + ROBOT.replace("max_speed_m_s = 2", "max_speed_m_s = 0.2"))
    done = call("plan", site, "--robot", walk)
    assert done.code == 1
    assert "robot.max_speed_m_s: found 0.2 m/s, expected at least" in done.err
    assert "the hop was lost for" in done.err


def test_a_car_follows_and_nobody_drives_through_obstacles(call, site, walk, tmp_path):
    car = ROBOT + "wheel_base_m = 0.3\n"
    text = site.read_text()
    site.write_text(text + car)
    assert call("plan", site, "--robot", walk, "--json").json["hop_kept"] > 0.95
    block = "[[obstacles]]\npolygon = [[3, 4], [4, 4], [4, 6], [3, 6]]\n"
    for kind in (ROBOT, car):
        site.write_text(text + kind + block)
        done = call("plan", site, "--robot", walk, "--plot", tmp_path / "way.png", "--json")
        inside = [3.0 < x < 4.0 and 4.0 < y < 6.0 for x, y in done.json["path_m"]]
        assert not any(inside)
        assert done.code == (done.json["hop_kept"] < 1.0)


def test_what_a_robot_lacks_is_told_at_once(call, site, walk):
    text = site.read_text().replace("max_range_m = 8\n", "")
    site.write_text(text + "[robot]\nwheel_base_m = 0.3\n")
    done = call("plan", site, "--robot", walk)
    assert done.code == 2
    for key in ("robot.comm_m", "robot.sensing_m", "robot.max_speed_m_s"):
        assert f"{key}: found nothing" in done.err
    site.write_text(text + ROBOT.replace("[network]\nhop_m = 9\n[[groups]]", "[[groups]]"))
    assert "robot.comm_m: found nothing" in call("plan", site, "--robot", walk).err
    site.write_text(text + ROBOT + "comm_m = 9\n")
    wrong = call("plan", site, "--robot", walk, "--target", "7")
    assert "--target: found '7', expected a target of" in wrong.err
    site.write_text(text + "[robot]\ncomm_m = 9\nsensing_m = 7\n")
    assert call("plan", site, "--robot", walk, "--json").json["hops_to_sink"] is None


def test_obstacles_have_three_corners(call, site):
    site.write_text(site.read_text() + "[[obstacles]]\npolygon = [[3, 4], [4, 4]]\n")
    done = call("plan", site)
    assert done.code == 2
    assert "obstacles[1].polygon: found 2 corners, expected 3 or more" in done.err


LIFE = """
[energy]
sleep_mw = 0
battery_j = 20
"""


def test_a_lifetime_is_counted_in_intervals_and_days(call, site, tmp_path):
    site.write_text(site.read_text() + LIFE)
    picture = tmp_path / "life.png"
    more = ("--passes-per-day", 2, "--clairvoyant", "--bound", 0.05)
    told = call("plan", site, "--lifetime", *more, "--plot", picture, "--json").json
    assert told["policy"] == "learned"
    assert told["battery_sensings"] == told["simulated_sensings"] == pytest.approx(20.0 / 3.33)
    first = told["intervals"]["first_death"]
    assert 0 < first <= told["nobody_longer_intervals"]
    assert told["days"]["first_death"] == pytest.approx(first / 50.0)  # asleep it spends nothing
    assert told["sleeping_days"] is None
    assert picture.exists()
    table = call("plan", site, "--lifetime", "--policy", "geometry", "--bound", 0.05)
    assert "first node exhausted" in table.out
    assert "days" not in table.out


def test_crossings_go_from_side_to_side(site):
    ways = plan_lifetime._crossings(load_site(site), 400, np.random.default_rng(0))
    region = np.array([[0.0, 0.0], [12.0, 10.0]])
    for end in (ways[:, 0], ways[:, -1]):
        on = np.isclose(end[:, None], region).any(axis=1)
        assert on.any(axis=1).all()
        assert on.mean(axis=0) == pytest.approx([0.5, 0.5], abs=0.1)
        assert ((end >= region[0] - 1e-9) & (end <= region[1] + 1e-9)).all()
    assert (np.linalg.norm(ways[:, -1] - ways[:, 0], axis=1) > 0.0).all()


def test_sleep_takes_its_share_of_the_days_and_long_lives_are_in_proportion(call, site, walk):
    site.write_text(site.read_text() + "[energy]\nbattery_j = 3000\n")
    passes = ("--truth", walk, "--passes-per-day", 1, "--bound", 0.05)
    told = call("plan", site, "--lifetime", *passes, "--policy", "cost", "--json").json
    assert told["simulated_sensings"] == 40 * 3 * 25 / 24  # 40 passes, if all can be served
    assert told["battery_sensings"] > 500.0
    assert told["days"]["first_death"] < told["sleeping_days"]
    assert told["days"]["first_death"] > 0.5 * told["sleeping_days"]


def test_a_bound_that_no_set_keeps_is_told_with_what_would_help(call, site):
    site.write_text(site.read_text() + LIFE)
    done = call("plan", site, "--lifetime", "--bound", 0.0001)
    assert done.code == 1
    assert "in 100 % of the intervals no 3 sensors reach 0.0001 m^2" in done.err


def test_a_lifetime_needs_ranges_and_sensing_that_costs(call, site, tmp_path):
    text = site.read_text()
    assert "expected one of: geometry" in call("plan", site, "--lifetime", "--policy", "x").err
    rate = call("plan", site, "--lifetime", "--passes-per-day", "-1")
    assert "--passes-per-day: found -1, expected a rate above 0" in rate.err
    free = "[energy]\nrx_mw = 0\ntx_mw = 0\nidle_mw = 0\nsense_mw = 0\n"
    site.write_text(text + free)
    assert "found sensing that costs no more than sleeping" in call("plan", site, "--lifetime").err
    site.write_text(
        text.replace('kind = "range"', 'kind = "bearing"').replace(
            "bias_m = 0\nscale = 0\nsigma_m = 0.1\n", ""
        )
    )
    done = call("plan", site, "--lifetime")
    assert done.code == 2
    assert "expected 'range' of all" in done.err
