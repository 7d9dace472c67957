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
