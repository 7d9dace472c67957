"""What simulated sensors say: directions, turn rates, motion, strengths of beacons, amplitudes."""

import numpy as np
import pytest

from conftest import ROOT
from trackfield.errors import ConfigurationError, InputError
from trackfield.metrics.score import score
from trackfield.pipeline.dispatch import tracker_of
from trackfield.pipeline.runs import track_readings
from trackfield.sensing import angular_rate, bearing, motion_rate, rssi
from trackfield.sensing.energy_message import decode
from trackfield.simulation.hearing import all_of, hear_readings
from trackfield.simulation.messages import draw_messages
from trackfield.simulation.scenario_file import load_scenario, scenario_from_toml
from trackfield.simulation.sources import clocks, levels
from trackfield.simulation.told_site import site_of
from trackfield.simulation.world import make_world

HEAD = """
duration_s = 100
step_s = 0.5
region = [0, 0, 30, 20]
[sensors]
layout = "listed"
positions = [[0, 0], [30, 0], [30, 20], [0, 20], [15, 10.5]]
"""
WALK = """
[[targets]]
motion = "walk"
count = 2
inset_m = 2
"""


def heard(text, *, seed=0):
    world = make_world(scenario_from_toml(HEAD + text, "s.toml"), seed=seed)
    return world, all_of(hear_readings(world))[0]


def true_states(world, readings):
    """Place and velocity of the target of each reading, by differences of the truth."""
    found = np.empty((len(readings), 4))
    for target in range(len(world.truth.target_ids)):
        own = world.truth.target == target
        place = world.truth.position[own, :2]
        states = np.hstack([place, np.gradient(place, world.scenario.step_s, axis=0)])
        rows = readings.target == target
        found[rows] = states[np.searchsorted(world.truth.t_s[own], readings.t_s[rows])]
    return found


def off_by_sensor(world, readings, expected):
    """Readings less what is expected of their own sensor, by a function of sensors and states."""
    states = true_states(world, readings)
    place = world.deployment.network.positions[readings.sensor]
    mean = [expected(place[i : i + 1], states[i]) for i in range(len(readings))]
    return readings.value - np.ravel(mean)


@pytest.mark.parametrize(
    ("text", "room", "sigma"),
    [
        ("[bearing]\nsigma_rad = 0.02\n", bearing, 0.02),
        ("[angular_rate]\nsigma_rad_s = 0.03\n", angular_rate, 0.03),
        ("[motion]\nsigma = 0.004\nfalloff = 0.5\n", motion_rate, 0.004),
    ],
    ids=("bearing", "angular_rate", "motion"),
)
def test_readings_are_those_of_the_truth_with_their_noise(text, room, sigma):
    world, readings = heard(text + WALK)
    (model,) = world.scenario.models.values()
    given = "positions" if room is bearing else "states"
    size = 2 if room is bearing else 4
    off = off_by_sensor(world, readings, lambda s, x: room.expected(model, s, **{given: x[:size]}))
    off = bearing.wrapped(off) if room is bearing else off
    assert abs(off.mean()) < 0.1 * sigma
    assert off.std() == pytest.approx(sigma, rel=0.05 if room is not motion_rate else 0.1)
    assert {*readings.target} == {0, 1}
    assert {readings.kinds[k] for k in readings.kind} == {*world.scenario.models}
    assert np.all(np.diff(readings.t_s) >= 0.0)


def test_beacons_share_the_shadows_of_the_field():
    """Two targets in one place hear the same shadow; over places it has the spread it is told."""
    text = "[rssi]\nsigma_db = 0.001\nshadow_db = 4\nshadow_m = 3\n"
    same = WALK.replace("inset_m = 2", "path = [[5, 5], [25, 15], [5, 15]]")
    world, readings = heard(text + same)
    model = world.scenario.rssi
    off = off_by_sensor(world, readings, lambda s, x: rssi.expected(model, rssi.distance(s, x[:2])))
    one, two = (off[readings.target == k] for k in (0, 1))
    np.testing.assert_allclose(one, two, atol=0.02)
    assert 2.0 < off.std() < 6.0


def test_what_is_too_weak_is_not_heard():
    world, readings = heard("[rssi]\nsigma_db = 0.1\nmin_dbm = -80\n" + WALK)
    assert readings.value.min() >= -80.0
    assert len(readings) < 5 * len(world.truth)
    _, silent = heard("[motion]\nthreshold = 0.05\n" + WALK)
    assert silent.value.min() >= 0.05


def test_kinds_that_stand_together_take_turns():
    world, readings = heard("[motion]\n[bearing]\n[angular_rate]\n" + WALK)
    kinds = {
        (readings.sensor_ids[s], readings.kinds[k])
        for s, k in zip(readings.sensor, readings.kind, strict=True)
    }
    turn = ("bearing", "angular_rate", "motion", "bearing", "angular_rate")
    assert kinds == {(f"s{i}", kind) for i, kind in enumerate(turn)}
    assert site_of(world).model_names == turn


ROW = """
[[targets]]
motion = "row"
count = 1
start = [5, 10]
speed_m_s = [0.2, 0.2]
level = 3.0
"""


def energy(world, level, exponent):
    """Energy (m, n) that a source of a level leaves at each sensor along its path."""
    path = world.truth.position[world.truth.target == 0, :2]
    r = np.linalg.norm(path[:, None] - world.deployment.network.positions[:5], axis=-1)
    return (level * r**-exponent) ** 2


def test_amplitudes_fall_with_distance_from_a_source_of_its_level():
    world, readings = heard("[amplitude]\nsigma = 0.02\nexponent = 1.5\n" + ROW)
    assert levels(world) == [3.0]
    values = readings.value.reshape(-1, 5)
    off = values - np.sqrt(energy(world, 3.0, 1.5))
    assert abs(off.mean()) < 0.002
    assert off.std() == pytest.approx(0.02, rel=0.05)
    assert np.all(readings.target == -1)


def test_energies_of_two_sources_add_up():
    """With hardly any noise, two targets side by side are heard as the root of both energies."""
    pair = ROW.replace("count = 1", "count = 2\nspacing_m = 1e-9")
    world, readings = heard("[amplitude]\nsigma = 1e-9\n" + pair)
    both = np.sqrt(2.0 * energy(world, 3.0, 1.0))
    np.testing.assert_allclose(readings.value.reshape(-1, 5), both, rtol=1e-6)


def test_an_empty_field_says_its_noise():
    world, readings = heard("[amplitude]\nsigma = 0.1\nfading = 'rayleigh'\n")
    assert len(readings) == 200 * 5
    assert len(world.truth) == 0
    assert np.mean(readings.value**2) == pytest.approx(0.01, rel=0.1)
    _, far = heard("[amplitude]\nsigma = 0.001\nmax_range_m = 0.4\n" + ROW)
    assert np.abs(far.value).max() < 0.01


MESSAGES = "[energy_message]\nsigma = 0.02\nsample_s = 0.5\nrecord_s = 30\n"


def test_messages_are_fits_of_the_records_that_follow_each_other():
    """Decoded, they tell when the source was nearest and how loud it was then."""
    near = ROW.replace("start = [5, 10]", "start = [12, 10]")
    world, readings = heard(MESSAGES + near)
    model = world.scenario.energy_message
    assert dict(zip(*np.unique(readings.t_s, return_counts=True), strict=True)) == {
        30.0: 5,
        60.0: 5,
        90.0: 5,
    }
    assert {readings.kinds[k] for k in readings.kind} == {"energy_message"}
    first = readings.sensor == 4  # at (15, 10.5): nearest after 15 s
    told = decode(model, readings.value[first][:1], end_s=30.0)
    assert told.profile.t_max_s[0] == pytest.approx(15.0, abs=0.2)
    assert told.profile.a_max[0] == pytest.approx(3.0 / 0.5, rel=0.05)


def test_a_record_without_anything_is_told_so():
    _, readings = heard(MESSAGES.replace("sigma = 0.02", "sigma = 1.0"))
    assert np.mean(readings.value == 0.0) > 0.9
    clock, told = heard(MESSAGES + "clock_sigma_s = 0.5\n" + ROW)
    np.testing.assert_allclose(told.t_s - told.arrival_s, clocks(clock)[told.sensor])


def test_clocks_are_off_each_by_its_own():
    world, readings = heard("[amplitude]\nclock_sigma_s = 0.2\n" + ROW)
    ahead = clocks(world)
    assert np.unique(ahead).size == 5
    np.testing.assert_allclose(readings.t_s - readings.arrival_s, ahead[readings.sensor])
    assert np.all(np.diff(readings.arrival_s) >= 0.0)
    same, _ = heard("[amplitude]\nclock_sigma_s = 0.2\n" + ROW)
    np.testing.assert_array_equal(clocks(same), ahead)
    plain, punctual = heard("[amplitude]\n" + ROW)
    assert not clocks(plain).any()
    assert np.isnan(punctual.arrival_s).all()


def test_a_stuck_microphone_and_a_silent_camera():
    fault = "[[faults]]\nkind = 'KIND'\nsensors = ['s1']\nfrom_s = 10\nto_s = 20\n"
    _, stuck = heard("[amplitude]\n" + ROW + fault.replace("KIND", "stuck") + "value = 7\n")
    there = (stuck.sensor == 1) & (stuck.t_s >= 10) & (stuck.t_s < 20)
    np.testing.assert_array_equal(stuck.value == 7.0, there)
    _, silent = heard("[bearing]\n" + WALK + fault.replace("KIND", "silent"))
    own = silent.t_s[silent.sensor == 1]
    assert not np.any((own >= 10) & (own < 20))
    assert own.size


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[bearing]\n[rssi]\n" + WALK, "found [bearing] and [rssi], expected one of"),
        ("[bearing]\nlevel = 1\n", "bearing.level: found an unknown key"),
        ("[bearing]\nsigma_rad = 0\n", "bearing.sigma_rad: found 0, expected a number above 0"),
        ("[amplitude]\nfading = 'rice'\n", "amplitude.fading: found 'rice', expected 'none' or"),
        ("[bearing]\n" + ROW, "targets[1].level: found 3 without [amplitude]"),
        ("[rssi]\n[scheduling]\n", "scheduling: found with [rssi], expected one of [signal]"),
        ("[energy_message]\n", "energy_message.sample_s: found 1, expected step_s = 0.5"),
        (
            "[energy_message]\nsample_s = 0.5\nrecord_s = 101\n",
            "energy_message.record_s: found 101, expected at most duration_s = 100",
        ),
        ("[energy_message]\nsample_s = 0.5\nbits = 18\n", "found 18, expected a whole number"),
        ("[motion]\n[pursuit]\n[[pursuers]]\nat = [1, 1]\n", "pursuit: found with [motion]"),
    ],
)
def test_what_cannot_be_is_told(text, told):
    with pytest.raises(ConfigurationError) as refused:
        scenario_from_toml(HEAD + text, "s.toml")
    assert any(told in problem for problem in refused.value.problems), refused.value.problems


def test_the_shipped_scenarios_of_these_kinds_say_something_of_everything():
    for name in ("rssi", "bearings", "rates", "motion", "energy", "messages"):
        world = make_world(load_scenario(ROOT / "examples" / "scenarios" / f"{name}.toml"))
        readings, _ = all_of(hear_readings(world))
        assert {*np.unique(readings.sensor)} == {*range(len(readings.sensor_ids))}, name


def test_only_messages_are_drawn_as_messages():
    world, _ = heard("[bearing]\n" + WALK)
    with pytest.raises(InputError, match=r"without \[energy_message\]"):
        draw_messages(world)


def test_a_network_that_delays_is_met_by_the_window():
    """Late readings within `window_s` count, the others are warned of: the track is still there."""
    delays = "[network]\np_delay = 0.3\ndelay_step_s = 0.5\np_loss = 0.1\nmultipath = false\n"
    world, late = heard("[bearing]\nsigma_rad = 0.02\n" + WALK + delays)
    assert np.any(np.diff(late.t_s) < 0.0)
    tracker = tracker_of(site_of(world), "angle")
    run = track_readings(tracker, [late])
    assert run.counts["rewound"] > 50
    assert 0 < run.counts["late"] < 0.2 * len(late)
    assert score(world.truth, run.tracks).median_m < 1.0
