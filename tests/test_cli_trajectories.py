"""Amplitudes and energy messages on the command line: trajectories told, doubts, wrong input."""

import numpy as np
import pytest

import cli_runs
from conftest import ROOT
from trackfield.io.tracks import read_tracks
from trackfield.sensing.amplitude import AmplitudeModel, noisy
from trackfield.sensing.energy_message import EnergyMessageModel
from trackfield.sensing.energy_message_making import simulate

SCENARIOS = ROOT / "examples" / "scenarios"
HEADER = "t_s,sensor_id,kind,value\n"
PLACES = np.array([[-20.0, 8.0], [-8.0, -12.0], [4.0, 9.0], [15.0, -7.0], [24.0, 12.0]])
MODEL = EnergyMessageModel(sigma=0.01, sample_s=0.5, record_s=40.0)


@pytest.fixture
def call(capsys):
    return cli_runs.caller(capsys)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The two shipped scenarios, simulated once with a seed of their own."""
    folder = tmp_path_factory.mktemp("made")
    for name in ("energy", "messages"):
        cli_runs.main(
            ["simulate", str(SCENARIOS / f"{name}.toml"), "-o", str(folder / name), "--seed", "7"]
        )
    return folder


def write(folder, kind, rows, *, places=PLACES, model=""):
    sensors = "".join(f"s{i},{x},{y}\n" for i, (x, y) in enumerate(places))
    (folder / "sensors.csv").write_text("sensor_id,x_m,y_m\n" + sensors)
    text = "[site]\nname = 'street'\nsensors_file = 'sensors.csv'\n[models.m]\n"
    own = "" if "sigma = " in model else "sigma = 0.01\n"
    (folder / "site.toml").write_text(f"{text}kind = '{kind}'\n{model}{own}")
    (folder / "data.csv").write_text(HEADER + "".join(rows))
    return folder / "site.toml", folder / "data.csv"


def messages(places=PLACES, *, seed=3):
    """Rows of messages of one pass from west to east; they name `MODEL`."""
    t = np.arange(-MODEL.record_s, MODEL.sample_s / 2, MODEL.sample_s)
    path = np.column_stack([30.0 + 1.5 * t, np.full(t.size, 1.0)])
    said = simulate(MODEL, places, path=path, power=1.0, rng=np.random.default_rng(seed))
    return [f"40,s{i},energy_message,{int(word)}\n" for i, word in enumerate(said.word)]


RECORD = "sample_s = 0.5\nrecord_s = 40\n"


@pytest.mark.parametrize("name", ["energy", "messages"])
def test_a_simulated_site_tracks_its_own_measurements(call, made, tmp_path, name):
    folder, tracks = made / name, tmp_path / "tracks.csv"
    site, data = folder / "site.toml", folder / "measurements.csv"
    assert call("check", site, data).code == 0
    done = call("track", site, data, "-o", tracks, "--json")
    assert (done.code, done.err) == (0, "")
    (one,) = done.json["trajectories"]
    assert one["weight"] == pytest.approx(1.0)
    assert len(one["sensors"]) >= 5
    sigma = np.sqrt(np.diag(one["covariance"]))
    heading = np.deg2rad(6.0)
    going = 1.7 * np.array([np.cos(heading), np.sin(heading)])
    place = np.array([-50.0, -4.0]) + one["t_s"] * going
    found = np.array([one["power"], *one["position"], *one["velocity"]])
    off = (found - [1.0, *place, *going]) / sigma
    assert np.all(np.abs(off) < 4.0)
    assert sigma[1:3].max() < 1.0
    score = call("score", folder / "truth.csv", tracks, "--json").json
    assert score["rmse_m"] < 1.5


def test_what_passed_is_told_in_words(call, made, tmp_path):
    folder = made / "messages"
    done = call(
        "track", folder / "site.toml", folder / "measurements.csv", "-o", tmp_path / "t.csv"
    )
    lines = done.out.splitlines()
    (first,) = [i for i, line in enumerate(lines) if line.startswith("trajectory 1: One ")]
    assert "+-" in lines[first + 1]
    assert lines[first + 2].endswith("m/s towards 6 deg from east")
    assert "heard by s0, s1, " in lines[first + 3]


def test_hindsight_tells_the_whole_pass(call, made, tmp_path):
    """Rows of a lag are where the target was that long ago, known what is known at the end."""
    folder, tracks = made / "messages", tmp_path / "tracks.csv"
    options = ("--lag", 60, "--every", 1, "--plot", tmp_path / "t.png")
    site, data = folder / "site.toml", folder / "measurements.csv"
    assert call("track", site, data, "-o", tracks, *options).code == 0
    assert len(read_tracks(tracks)) > 50
    score = call("score", folder / "truth.csv", tracks, "--json").json
    assert score["rmse_m"] < 1.5
    assert score["availability"] > 0.9
    done = call("track", site, data, "-o", tracks, "--lag", "5steps")
    assert (done.code, "--lag: found '5steps', expected seconds" in done.err) == (2, True)
    assert call("track", site, data, "-o", tracks, "--lag", "1e6").code == 0
    assert len(read_tracks(tracks)) == 21
    score = call("score", folder / "truth.csv", tracks, "--json").json
    assert score["rmse_m"] < 1.5


def test_one_after_the_other_both_are_told(call, tmp_path):
    """A pass that is over when the run ends is not forgotten; levels are those of the sources."""
    scenario = (SCENARIOS / "energy.toml").read_text().replace("= 60.0", "= 140.0")
    party = scenario[scenario.index("[[targets]]") :]
    other = party.replace("[-50, -4]", "[50, 3]").replace("= 6\n", "= 185\nlevel = 2.0\n")
    other = other.replace("count = 1", "count = 1\nenter_s = [70, 75]")
    (tmp_path / "two.toml").write_text(scenario + other)
    folder = tmp_path / "two"
    assert call("simulate", tmp_path / "two.toml", "-o", folder, "--seed", 3).code == 0
    site, data = folder / "site.toml", folder / "measurements.csv"
    done = call("track", site, data, "-o", tmp_path / "t.csv", "--json")
    one, two = done.json["trajectories"]
    assert (one["velocity"][0], two["velocity"][0]) == pytest.approx((1.69, -1.69), abs=0.1)
    assert (one["power"], two["power"]) == pytest.approx((1.0, 4.0), rel=0.15)
    assert done.json["readings"]["started"] == 2


def test_an_ambiguity_is_told_and_not_hidden(call, tmp_path):
    """Sensors in a line hear a trajectory and its mirror image alike."""
    line = np.column_stack([np.linspace(-20.0, 24.0, 5), np.full(5, -6.0)])
    site, data = write(tmp_path, "energy_message", messages(line), places=line, model=RECORD)
    assert "all on one line" in call("check", site, data).out
    done = call("track", site, data, "-o", tmp_path / "t.csv", "--json")
    assert done.code == 0
    both = done.json["trajectories"]
    assert len(both) == 2
    assert sum(one["weight"] for one in both) == pytest.approx(1.0)
    assert min(one["weight"] for one in both) > 0.3
    north = [one["position"][1] for one in both]
    assert np.mean(north) == pytest.approx(-6.0, abs=0.1)  # mirrored about the line
    assert any("2 trajectories explain what was heard" in odd for odd in done.json["warnings"])
    assert (done.json["shown"], done.json["rows"] >= 2) == (0, True)
    told = call("track", site, data, "-o", tmp_path / "t.csv")
    assert told.out.count("\ntrajectory ") == 2


def test_a_clear_pass_among_five_sensors(call, tmp_path):
    site, data = write(tmp_path, "energy_message", messages(), model=RECORD)
    done = call("track", site, data, "-o", tmp_path / "t.csv", "--json")
    (one,) = done.json["trajectories"]
    assert one["velocity"] == pytest.approx([1.5, 0.0], abs=0.1)
    assert done.json["warnings"] == []


GOOD = messages()
SAMPLE = "0,s0,amplitude,0.5\n"


@pytest.mark.parametrize(
    ("kind", "rows", "model", "words"),
    [
        ("energy_message", ["40,s0,energy_message,1234.5\n"], RECORD, "1234.5"),
        ("energy_message", ["40,s0,energy_message,-1\n"], RECORD, "a whole number of 0 or more"),
        (
            "energy_message",
            ["40,s0,energy_message,1e12\n"],
            RECORD,
            "expected 0, or a whole number",
        ),
        ("energy_message", ["40,s9,energy_message,0\n"], RECORD, "expected a sensor of the site"),
        ("energy_message", [GOOD[0]], RECORD, "found 1 sensors (s0), expected at least 3"),
        ("energy_message", [*GOOD[:2], "40,s2,amplitude,1\n"], RECORD, "expected one kind"),
        ("energy_message", GOOD, "bits = 18\n", "a whole number from 2 to 17"),
        ("amplitude", [SAMPLE], "", "found 1 sensors (s0), expected at least 3"),
        ("amplitude", [SAMPLE, "0,s1,amplitude,nan\n"], "", "expected a finite number"),
        (
            "amplitude",
            [SAMPLE, "0,s1,amplitude,-0.5\n"],
            "fading = 'rayleigh'\n",
            "found amplitude -0.5, expected 0 or more",
        ),
        ("amplitude", GOOD, "", "found kind 'energy_message'"),
    ],
)
def test_wrong_input_is_one_message_and_exit_2(call, tmp_path, kind, rows, model, words):
    site, data = write(tmp_path, kind, rows, model=model)
    done = call("track", site, data, "-o", tmp_path / "tracks.csv")
    assert done.code == 2
    assert words in done.err
    assert done.err.count("error: ") == 1
    assert "Traceback" not in done.err
    assert not (tmp_path / "tracks.csv").exists()


@pytest.mark.parametrize(
    "rows",
    [
        [f"0,s{i},amplitude,0.5\n" for i in range(5)],  # one sample each
        [f"{k},s{i},amplitude,0.0\n" for k in range(40) for i in range(5)],  # nothing at all
        [f"{k},s{i},amplitude,0.5\n" for k in range(40) for i in range(5)],  # flat
        [f"{k},s{i},amplitude,2\n" for k in range(40) for i in range(5)],  # clipped
    ],
    ids=("one sample", "silence", "flat", "clipped"),
)
def test_profiles_that_say_nothing_make_no_confident_trajectory(call, tmp_path, rows):
    site, data = write(tmp_path, "amplitude", rows, model="saturation = 2\n")
    done = call("track", site, data, "-o", tmp_path / "t.csv", "--json")
    assert "Traceback" not in done.err
    if done.code == 2:
        assert "no time at which a track could start" in done.err
        return
    assert done.code == 0
    assert done.json["shown"] == 0
    assert all(one["verdict"] != "good" for one in done.json["trajectories"])
    assert f"{data}: no track was confirmed" in done.json["warnings"]


def sources(ways, *, sigma=0.01, exponent=1.0, fading="none", model="", target=""):
    """Rows of samples that the sensors of `PLACES` take of targets of power 1 on straight ways."""
    rng, kind = np.random.default_rng(4), AmplitudeModel(exponent, sigma, fading)
    rows = []
    for t in np.arange(0.0, 40.0, 0.5):
        places = np.array([start + t * np.asarray(speed) for start, speed in ways])
        r = np.linalg.norm(places[:, None] - PLACES, axis=-1)
        z = noisy(kind, np.sqrt(np.sum(r ** (-2.0 * exponent), axis=0)), rng=rng)
        rows += [f"{t:g},s{i},amplitude,{own:.6g}{target}\n" for i, own in enumerate(z)]
    return rows


PASS = [(np.array([-30.0, 1.0]), (1.5, 0.0))]


@pytest.mark.parametrize(
    ("ways", "sent", "model"),
    [
        (PASS, {}, "sigma = 0.00001\n"),  # mV for V
        (PASS, {}, "exponent = 3\n"),
        (PASS, {"fading": "rayleigh"}, ""),
        ([*PASS, (np.array([30.0, -9.0]), (-1.6, 0.3))], {}, ""),
    ],
    ids=("sigma", "exponent", "fading", "two"),
)
def test_what_is_loud_but_fits_no_pass_is_told_with_what_may_be_wrong(
    call, tmp_path, ways, sent, model
):
    """No track, or one that is not sure; and the reader is told where to look."""
    site, data = write(tmp_path, "amplitude", sources(ways, **sent), model=model)
    done = call("track", site, data, "-o", tmp_path / "t.csv", "--json")
    if done.code == 2:
        assert "5 heard something so loud, but nothing that fits a pass" in done.err
        assert "sigma, exponent and fading" in done.err
        return
    assert done.json["shown"] == 0
    doubts = " ".join(done.json["warnings"])
    assert "No straight pass of one target explains the messages." in doubts


def test_samples_above_the_saturation_are_counted_and_told(call, tmp_path):
    rows = sources(PASS)
    above = sum(float(row.rsplit(",", 1)[1]) > 0.12 for row in rows)
    site, data = write(tmp_path, "amplitude", rows, model="saturation = 0.12\n")
    done = call("track", site, data, "-o", tmp_path / "t.csv", "--json")
    assert done.json["readings"]["saturated"] == above > 5
    assert any(
        f"{above} samples are above their model's saturation" in w for w in done.json["warnings"]
    )


def test_a_method_is_refused(call, tmp_path):
    site, data = write(tmp_path, "energy_message", GOOD, model=RECORD)
    done = call("track", site, data, "-o", tmp_path / "t.csv", "--method", "imm")
    assert done.code == 2
    assert "expected none for amplitudes and their messages" in done.err


def test_clocks_beyond_the_window_are_counted(call, tmp_path):
    """A message whose clock is far behind all others is too late to be of this pass."""
    late = GOOD[4].replace("40,", "-100000,", 1)
    site, data = write(tmp_path, "energy_message", [*GOOD[:4], late], model=RECORD)
    done = call("track", site, data, "-o", tmp_path / "t.csv", "--json")
    assert done.code == 0
    assert done.json["readings"]["late"] == 1
    assert any("came later than" in odd for odd in done.json["warnings"])
