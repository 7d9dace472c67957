"""Pursuit and evasion in one loop: captures, what pursuers know, and what they keep clear of."""

from dataclasses import replace

import numpy as np
import pytest

from trackfield.errors import ConfigurationError, InputError
from trackfield.experiments.oh_walkers import scenario as walkers
from trackfield.simulation.evaders import Evaders
from trackfield.simulation.game import Game
from trackfield.simulation.game_outcome import played
from trackfield.simulation.scenario import Pursuer, Pursuit
from trackfield.simulation.scenario_file import scenario_from_toml
from trackfield.simulation.world import make_world

HEAD = "duration_s = 40.0\nregion = [0, 0, 40, 40]\n[reports]\nsigma_m = 0.3\n"
TWO = """
[[targets]]
motion = "random"
count = 2
at_start = 2
border = "bounce"
speed_m_s = [0.5, 1.0]
accel_sigma_m_s2 = 0.05
"""
CHASE = """
[pursuit]
capture_m = 1.0
[[pursuers]]
at = [10, 20]
[[pursuers]]
at = [30, 20]
"""


def outcome(text, seed=1):
    return played(make_world(scenario_from_toml(text), seed=seed))


def test_walkers_in_a_binary_field_are_captured_without_a_collision():
    both = 0
    for seed in range(2, 6):
        world = replace_pursuit(walkers(2, np.random.default_rng(seed)))
        found = played(make_world(world, seed=seed))
        both += found.captured == 2
        assert found.collisions == 0
        assert found.apart_m >= 1.0
    assert both >= 3


def replace_pursuit(scenario):
    places = (Pursuer((20.0, 30.0)), Pursuer((40.0, 30.0)))
    return replace(scenario, pursuit=Pursuit(), pursuers=places)


@pytest.mark.parametrize("vehicle", ["thruster", "runner", "car"])
def test_every_vehicle_captures_what_is_reported(vehicle):
    text = HEAD + TWO + CHASE.replace("[pursuit]", f'[pursuit]\nvehicle = "{vehicle}"')
    found = outcome(text)
    assert found.captured == 2
    for fate in found.fates:
        assert fate.from_s == 0.0
        assert fate.to_s == 40.0
        assert fate.chased_s < fate.captured_s < 40.0
        assert abs(fate.expected_s - fate.captured_s) < 15.0
        last = found.truth.t_s[found.truth.target == int(fate.target[1:]) - 1].max()
        assert last == fate.captured_s  # and is gone
    assert found.paths.shape == (40, 2, 2)
    np.testing.assert_array_equal(found.paths[0], [[10.0, 20.0], [30.0, 20.0]])


def test_a_capture_is_by_truth_and_needs_its_steps():
    text = HEAD + TWO + CHASE
    one = outcome(text.replace("capture_m = 1.0", "capture_m = 1.0\nconfirm_steps = 1"))
    three = outcome(text.replace("capture_m = 1.0", "capture_m = 1.0\nconfirm_steps = 3"))
    for first, later in zip(one.fates, three.fates, strict=True):
        assert later.captured_s is None or later.captured_s > first.captured_s
    for fate in one.fates:
        k = int(fate.captured_s)
        place = one.truth.position[
            (one.truth.t_s == k) & (one.truth.target == int(fate.target[1]) - 1)
        ]
        assert np.linalg.norm(one.paths[k, fate.pursuer] - place[0, :2]) <= 1.0


def test_knowing_the_truth_captures_no_later():
    text = HEAD + TWO + CHASE
    exact = text.replace("[pursuit]", '[pursuit]\nsight = "exact"')
    late = {"tracks": [], "exact": []}
    for seed in range(6):
        late["tracks"] += [fate.captured_s or 40.0 for fate in outcome(text, seed).fates]
        late["exact"] += [fate.captured_s or 40.0 for fate in outcome(exact, seed).fates]
    assert np.mean(late["exact"]) < np.mean(late["tracks"])


def test_who_flees_is_captured_later_and_keeps_its_limits():
    still = HEAD + TWO + CHASE.replace("[pursuit]", '[pursuit]\nsight = "exact"')
    still = still.replace("capture_m = 1.0", "capture_m = 0.4")
    fleeing = still.replace("accel_sigma_m_s2 = 0.05", "evade_m_s2 = 0.8")
    late = [[], []]
    for seed in range(6):
        for some, text in zip(late, (still, fleeing), strict=True):
            found = outcome(text, seed)
            some += [fate.captured_s or 40.0 for fate in found.fates]
        for j in range(2):
            path = found.truth.position[found.truth.target == j, :2]
            assert path.min() >= 0.0
            assert path.max() <= 40.0
            assert np.abs(np.diff(path, axis=0)).max(initial=0.0) <= 1.0 + 1e-9
    assert np.mean(late[1]) > 1.1 * np.mean(late[0])


def test_without_pursuit_nobody_flees_and_a_capture_takes_an_evader_away():
    text = HEAD + TWO.replace("accel_sigma_m_s2 = 0.05", "evade_m_s2 = 0.4") + CHASE
    world = make_world(scenario_from_toml(text), seed=0)
    evaders = Evaders(world)
    np.testing.assert_array_equal(evaders.truth.position, world.truth.position)
    evaders.flee(0, np.zeros((0, 4)), Game(world)._coordinator.vehicle)
    evaders.capture(1, 3)
    assert evaders.at(3).target.tolist() == [0, 1]
    assert evaders.at(4).target.tolist() == [0]
    assert evaders.truth.t_s[evaders.truth.target == 1].max() == 3.0
    assert evaders.world.scenario is world.scenario


SHAPES = """
[[obstacles]]
corners = [[12, 12], [18, 12], [18, 18], [12, 18]]
[[obstacles]]
corners = [[25, 8], [30, 10], [27, 16]]
[[obstacles]]
corners = [[10, 26], [16, 24], [22, 30], [14, 32]]
"""


def crowd(seed):
    """Eight pursuers and eight evaders among polygons, with actuators that err."""
    rng = np.random.default_rng(seed)
    spots = np.array([[2.0 + 5.0 * i, y] for i in range(8) for y in (3.0, 37.0)])
    places = spots[rng.permutation(16)[:8]]
    text = HEAD.replace("40.0", "25.0") + TWO.replace("= 2", "= 8") + SHAPES
    text += '[pursuit]\nsight = "exact"\nspeed_m_s = 2.0\nerror_m_s2 = 0.05\ncapture_m = 0.5\n'
    text += "confirm_steps = 4\n"
    text += "".join(f"[[pursuers]]\nat = {place.tolist()}\n" for place in places)
    return scenario_from_toml(text)


def test_eight_pursuers_among_obstacles_always_keep_clear():
    captured = 0
    for seed in range(2):
        found = played(make_world(crowd(seed), seed=seed))
        assert found.apart_m >= 1.0
        assert found.clear_m >= 0.5
        assert found.collisions == 0
        captured += found.captured
        assert not any("off its way" in line for line in found.troubles)
    assert captured >= 6


def test_false_reports_and_a_lossy_network_do_not_stop_it():
    text = HEAD.replace("sigma_m = 0.3", "sigma_m = 0.5\np_detection = 0.6\nfalse_per_scan = 5.0")
    text += TWO + CHASE + "[sensors]\nspacing_m = 10.0\n[network]\np_loss = 0.2\np_delay = 0.3\n"
    found = outcome(text.replace("capture_m = 1.0", "capture_m = 2.0"))
    assert found.captured >= 1
    assert found.counts["steps"] == 40


def test_signals_are_tracked_too():
    text = HEAD.replace("[reports]\nsigma_m = 0.3", "[signal]\n[sensors]\nspacing_m = 4.0")
    found = outcome((text + TWO + CHASE).replace("capture_m = 1.0", "capture_m = 2.0"))
    assert found.captured == 2


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (HEAD + TWO + "[pursuit]\n", "pursuers: found 0, expected from 1 to 200"),
        (HEAD + TWO + "[[pursuers]]\nat = [1, 1]\n", "pursuers: found without [pursuit]"),
        (HEAD + SHAPES, "obstacles: found without [pursuit]"),
        (HEAD + CHASE.replace("30, 20", "10.2, 20"), "pursuers: pursuer 1 at [10.2, 20.0]"),
        (HEAD + SHAPES + CHASE.replace("30, 20", "15, 15"), "pursuers: pursuer 1 at [15.0, 15.0]"),
        (
            HEAD + CHASE.replace("capture_m", "error_m_s2"),
            "pursuit.error_m_s2: found 1, expected less than a third",
        ),
        (
            HEAD + CHASE.replace("capture_m = 1.0", 'vehicle = "runner"\nthrust_m_s2 = 2.0'),
            "pursuit.thrust_m_s2: found with vehicle 'runner'; it is for 'thruster'",
        ),
        (
            HEAD + SHAPES + CHASE.replace("capture_m = 1.0", 'vehicle = "car"').replace("30", "15"),
            "",
        ),
        (
            HEAD + SHAPES + '[pursuit]\nvehicle = "car"\n[[pursuers]]\nat = [15, 15]\n',
            "pursuers[1].at: found [15.0, 15.0], in an obstacle",
        ),
        (
            HEAD + "[[obstacles]]\ncorners = [[0, 0], [1, 1]]\n" + CHASE,
            "obstacles[1].corners: ",
        ),
        (
            HEAD + TWO.replace('"bounce"', '"leave"') + "evade_m_s2 = 0.1\n" + CHASE,
            "targets[1].evade_m_s2: found with border 'leave', expected 'bounce'",
        ),
        (HEAD + TWO + "evade_m_s2 = 0.1\n", "targets[1].evade_m_s2: found without [pursuit]"),
        (HEAD + CHASE + "[scheduling]\n", "pursuit: found with [scheduling]"),
        (
            HEAD.replace("[reports]\nsigma_m", "[sensors]\n[range]\nsigma_m") + CHASE,
            "pursuit: found with [range]",
        ),
    ],
)
def test_a_faulty_pursuit_is_refused(text, said):
    if not said:
        scenario_from_toml(text)
        return
    with pytest.raises(ConfigurationError) as caught:
        scenario_from_toml(text)
    assert any(said in problem for problem in caught.value.problems), caught.value.problems


def test_a_world_without_pursuit_is_no_game():
    with pytest.raises(InputError, match="without pursuit"):
        Game(make_world(scenario_from_toml(HEAD + TWO), seed=0))
