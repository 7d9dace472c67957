"""`trackfield score`: numbers by target, and what cannot be compared."""

import pytest

import cli_runs

TRACKS = "t_s,track_id,x_m,y_m,z_m,vx_m_s,vy_m_s,vz_m_s,cov_xx,cov_xy,cov_yy,status,target_id\n"


@pytest.fixture
def call(capsys):
    return cli_runs.caller(capsys)


@pytest.fixture
def files(tmp_path):
    truth, tracks = tmp_path / "truth.csv", tmp_path / "tracks.csv"
    truth.write_text(
        "t_s,target_id,x_m,y_m\n0,a,0,0\n1,a,1,0\n2,a,2,0\n0,b,0,9\n1,b,0,9\n2,b,0,9\n"
    )
    tracks.write_text(
        TRACKS + "0.5,1,0.5,3,,0,0,,1,0,1,confirmed,a\n1.5,1,1.5,-3,,0,0,,1,0,1,coasting,a\n"
        "0.5,2,4,9,,0,0,,1,0,1,confirmed,b\n0.7,2,99,9,,0,0,,1,0,1,tentative,b\n"
    )
    return truth, tracks


def test_every_target_is_scored_and_all_together(call, files):
    done = call("score", *files, "--json")
    assert done.code == 0
    found = done.json
    assert found["rows"] == 3
    assert found["rmse_m"] == pytest.approx(((9 + 9 + 16) / 3) ** 0.5)
    assert {name: one["rmse_m"] for name, one in found["targets"].items()} == {"a": 3.0, "b": 4.0}
    assert found["nis"] is None


def test_the_table_names_targets_and_units(call, files):
    done = call("score", *files)
    assert (done.code, done.err) == (0, "")
    for part in ("RMSE [m]", "p95 [m]", "a ", "b ", "all", "3.000", "4.000"):
        assert part in done.out


def test_longer_gaps_of_the_truth_are_bridged_on_demand(call, files):
    truth, tracks = files
    truth.write_text("t_s,target_id,x_m,y_m\n0,a,0,0\n2,a,2,0\n")
    assert call("score", truth, tracks).code == 2
    assert call("score", truth, tracks, "--max-gap", "2", "--json").json["rows"] == 2


@pytest.mark.parametrize(
    ("which", "content", "message"),
    [
        (0, "t_s,target_id,x_m,y_m\n50,a,0,0\n", "tracks at 0.5 to 1.5 s, truth at 50 to 50 s"),
        (0, "t_s,target_id,x_m,y_m\n", "truth.csv: found no rows"),
        (0, "t_s,target_id,x_m,y_m\n0,z,0,0\n0,y,0,0\n", "tracks of a, b, truth of z, y"),
        (1, TRACKS, "none of the 0 rows of the tracks is confirmed"),
        (1, "t_s,track\n", "tracks.csv, line 1"),
        (1, b"\x00\x01", "tracks.csv, line 1: found binary data"),
    ],
)
def test_what_cannot_be_compared_is_told(call, files, which, content, message):
    files[which].write_bytes(content if isinstance(content, bytes) else content.encode())
    done = call("score", *files, "--json")
    assert (done.code, done.out) == (2, "")
    (line,) = done.err.splitlines()
    assert line.startswith("error: ")
    assert message in line


@pytest.fixture
def crowd(tmp_path):
    """Two targets, and tracks without names: both found, swapped at 3 s, and one false."""
    truth, tracks = tmp_path / "truth.csv", tmp_path / "tracks.csv"
    steps = [(t, who) for t in range(6) for who in (0, 1)]
    truth.write_text(
        "t_s,target_id,x_m,y_m\n" + "".join(f"{t},{'ab'[w]},{t},{9 * w}\n" for t, w in steps)
    )
    rows = [(t, (w + (t >= 3)) % 2, t, 9 * w + 3) for t, w in steps] + [(5, 7, 50, 50)]
    tracks.write_text(
        TRACKS + "".join(f"{t},{i},{x},{y},,0,0,,1,0,1,confirmed,\n" for t, i, x, y in rows)
    )
    return truth, tracks


def test_tracks_without_names_are_scored_as_sets(call, crowd):
    done = call("score", *crowd, "--json")
    assert (done.code, done.err) == (0, "")
    assert done.json["switches"] == 2
    assert done.json["mota"] == pytest.approx(1 - 3 / 12)
    assert done.json["motp_m"] == 3.0
    assert done.json["idf1"] == pytest.approx(2 * 6 / 25)
    gospa = [18**0.5] * 5 + [(18 + 12.5) ** 0.5]
    assert done.json["gospa_m"] == pytest.approx(sum(gospa) / 6)
    assert "rmse_m" not in done.json


def test_the_table_of_many_targets_tells_what_is_best(call, crowd):
    done = call("score", *crowd)
    assert (done.code, done.err) == (0, "")
    assert "2 targets, 3 tracks, 6 steps; c 5 m, p 2, match 5 m" in done.out
    for part in ("GOSPA [m]", "MOTA", "0.750", "IDF1", "longest segment"):
        assert part in done.out


def test_many_targets_may_have_their_own_measure(call, crowd):
    done = call("score", *crowd, "--cutoff", "2", "--order", "1", "--match", "4", "--json")
    assert done.json["matches"] == 12
    assert done.json["gospa_m"] == pytest.approx((5 * 4 + 5) / 6)
    assert call("score", *crowd, "--match", "2", "--json").json["matches"] == 0
    for option in ("--cutoff", "--match"):
        refused = call("score", *crowd, option, "0")
        assert refused.code == 2
        assert "found a" in refused.err


def test_rows_between_steps_are_told(call, crowd):
    tracks = crowd[1]
    tracks.write_text(tracks.read_text().replace("\n5,7,", "\n4.7,7,"))
    assert call("score", *crowd).err == ""
    done = call("score", *crowd, "--tolerance", "0.1", "--json")
    assert done.err == "warning: 1 shown rows are at no step of the truth: not scored\n"
    assert done.json["off_steps"] == 1


def test_named_tracks_are_scored_as_many_on_demand(call, files):
    assert "switches" not in call("score", *files, "--json").json
    done = call("score", *files, "--many", "--json")
    assert done.code == 0
    assert (done.json["tracks"], done.json["switches"]) == (2, 0)


def test_no_tracks_at_all_can_be_scored_as_many(call, files):
    files[1].write_text(TRACKS)
    assert call("score", *files).code == 2
    found = call("score", *files, "--many", "--json").json
    assert (found["mota"], found["misses"]) == (0.0, 6)
    assert found["motp_m"] is None


def test_gaps_of_the_truth_of_many_are_bridged_on_demand(call, crowd):
    truth, _ = crowd
    truth.write_text(truth.read_text().replace("2,a,2,0\n", ""))
    assert call("score", *crowd, "--json").json["misses"] == 0
    assert call("score", *crowd, "--json").json["false_positives"] == 2
    assert call("score", *crowd, "--json", "--max-gap", "2").json["false_positives"] == 1


def test_many_targets_are_drawn(call, crowd, tmp_path):
    picture = tmp_path / "score.png"
    done = call("score", *crowd, "--plot", picture, "--json")
    assert (done.code, done.json["switches"]) == (0, 2)
    assert picture.stat().st_size > 10_000
    refused = call("score", *crowd, "--plot", crowd[0])
    assert (refused.code, refused.out) == (2, "")


def test_options_of_many_are_refused_where_targets_have_names(call, files, tmp_path):
    done = call("score", *files, "--cutoff", "3", "--plot", tmp_path / "a.png")
    assert (done.code, done.out) == (2, "")
    assert "found --cutoff, --plot and tracks that name their targets" in done.err
    assert call("score", *files, "--cutoff", "3", "--many", "--json").json["cutoff_m"] == 3.0


def test_targets_with_other_times_each_are_told(call, crowd):
    truth, _ = crowd
    truth.write_text(
        "t_s,target_id,x_m,y_m\n"
        + "".join(f"{t + w / 2},{'ab'[w]},{t},{9 * w}\n" for t in range(6) for w in (0, 1))
    )
    assert "a row at 55 % of the steps" in call("score", *crowd).err
    assert call("score", *crowd, "--max-gap", "1").err == ""
