"""The public names: what they take, and that all forms of a run give the same tracks."""

import numpy as np
import pytest

import cli_runs
import trackfield
from conftest import ROOT
from score_runs import make_tracks, make_truth
from trackfield.errors import ConfigurationError, InputError
from trackfield.simulation.hearing import all_of, hear_readings
from trackfield.simulation.scenario_file import load_scenario
from trackfield.simulation.told_site import site_of
from trackfield.simulation.world import make_world
from trackfield.types import select_rows


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return cli_runs.write_run(tmp_path_factory.mktemp("run"))


def test_every_public_name_is_there_and_documented():
    for name in trackfield.__all__:
        value = getattr(trackfield, name)
        assert name == "__version__" or value.__doc__, name
        assert name in dir(trackfield)
    with pytest.raises(AttributeError, match="has no attribute 'fly'"):
        _ = trackfield.fly


def test_the_list_of_names_is_the_table_of_rooms():
    assert set(trackfield.__all__) == {*trackfield._ROOM_OF, "__version__"}


def test_all_forms_of_a_run_give_the_same_tracks(run):
    site = trackfield.load_site(run / "site.toml")
    readings = trackfield.read_readings(run / "measurements.csv", sensor_ids=site.sensor_ids)
    columns = {
        "t_s": readings.t_s,
        "sensor_id": np.array(readings.sensor_ids)[readings.sensor],
        "kind": ["range"] * len(readings),
        "value": readings.value,
        "target_id": ["tag"] * len(readings),
    }
    forms = [
        (site, readings),
        (run / "site.toml", str(run / "measurements.csv")),
        (str(run / "site.toml"), columns),
        (site, iter([readings])),
    ]
    first, *others = [trackfield.track(*form, lag_s=1.0) for form in forms]
    assert len(first) > 300
    for other in others:
        np.testing.assert_array_equal(first.position, other.position)
        np.testing.assert_array_equal(first.t_s, other.t_s)


def test_a_data_frame_is_a_run_too(run):
    pandas = pytest.importorskip("pandas")
    frame = pandas.read_csv(run / "measurements.csv")
    tracks = trackfield.track(run / "site.toml", frame)
    by_path = trackfield.track(run / "site.toml", run / "measurements.csv")
    np.testing.assert_array_equal(tracks.position, by_path.position)
    assert {"t_s", "x_m", "target_id"} <= set(tracks.to_pandas().columns)


def test_chunks_may_be_columns_and_truth_may_be_a_frame(run):
    pandas = pytest.importorskip("pandas")
    frame = pandas.read_csv(run / "measurements.csv")
    whole = trackfield.track(run / "site.toml", frame)
    parts = trackfield.track(run / "site.toml", [frame.iloc[:150], frame.iloc[150:]])
    np.testing.assert_array_equal(parts.position, whole.position)
    truth = pandas.read_csv(run / "truth.csv")
    by_path = trackfield.score(run / "truth.csv", whole)
    assert trackfield.score(truth, whole) == by_path


@pytest.mark.parametrize("wrong", [None, 3, np.ones((5, 4)), [1.0], [[0.0, "A"]]])
def test_what_is_no_run_is_refused(run, wrong):
    with pytest.raises(InputError, match=r"readings: found .*, expected a mapping of columns"):
        trackfield.track(run / "site.toml", wrong)


def test_calibrate_track_and_score_go_together(run, tmp_path):
    files = (run / "site.toml", run / "measurements.csv", run / "truth.csv")
    site = trackfield.calibrate(*files).site
    trackfield.write_site(site, tmp_path / "c.toml")
    tracks = trackfield.track(tmp_path / "c.toml", run / "measurements.csv")
    trackfield.write_tracks(tmp_path / "t.csv", tracks)
    by_value = trackfield.score(trackfield.read_truth(run / "truth.csv"), tracks)
    by_path = trackfield.score(run / "truth.csv", tmp_path / "t.csv")
    assert by_value.rmse_m < 0.12
    assert by_path.rmse_m == pytest.approx(by_value.rmse_m, abs=1e-5)


def test_bad_arguments_raise_our_errors(run):
    with pytest.raises(ConfigurationError, match="found no such file"):
        trackfield.track("nowhere.toml", run / "measurements.csv")
    with pytest.raises(InputError, match="'sensor_id'"):
        trackfield.track(run / "site.toml", {"t_s": [0.0], "value": [1.0], "kind": ["range"]})
    columns = {"t_s": [0.0], "sensor_id": ["Z"], "kind": ["range"], "value": [1.0]}
    with pytest.raises(InputError, match="a sensor of the site"):
        trackfield.track(run / "site.toml", columns)


def test_tracks_without_names_have_the_score_of_many():
    rows = [(t, who, float(t), 9.0 * who) for t in range(5) for who in (0, 1)]
    truth, tracks = make_truth(rows), make_tracks(rows)
    found = trackfield.score(truth, tracks)
    told = trackfield.score(truth, tracks, many=True, max_gap_s=0.0)
    assert found.to_dict() == told.to_dict()
    assert found.clear_mot.mota == 1.0
    with pytest.raises(InputError, match="share no target"):
        trackfield.score(truth, tracks, many=False)


def test_readings_that_know_no_distance_are_tracked_in_the_same_way():
    """A file, its readings and their columns give the same rows; chunks of them too."""
    world = make_world(load_scenario(ROOT / "examples" / "scenarios" / "rates.toml"))
    readings, _ = all_of(hear_readings(world))
    site = site_of(world)
    whole = trackfield.track(site, readings)
    assert len(whole) > 50
    chunks = [select_rows(readings, slice(a, a + 100)) for a in range(0, len(readings), 100)]
    for data in (readings.to_numpy(), chunks):
        np.testing.assert_array_equal(trackfield.track(site, data).position, whole.position)
    lagged = trackfield.track(site, readings, lag_s=1.0)
    assert lagged.covariance[20:80, 0].mean() < whole.covariance[20:80, 0].mean()


def test_messages_of_passes_are_tracked_too():
    world = make_world(load_scenario(ROOT / "examples" / "scenarios" / "messages.toml"), seed=2)
    readings, _ = all_of(hear_readings(world))
    tracks = trackfield.track(site_of(world), readings, lag_s=30.0, every_s=1.0)
    found = trackfield.score(world.truth, tracks, many=False)
    assert found.rmse_m < 1.5
