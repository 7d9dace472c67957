"""Births: learned from targets that have come, and from nothing else."""

import numpy as np
import pytest

from test_association_bernoulli import scan, walk
from trackfield.association.bernoulli import Bernoulli
from trackfield.association.model import USUAL_BIRTHS_PER_S, Reporting, Scene, Targets
from trackfield.association.window import Known, window
from trackfield.raster import Region

SIDE_M = 200.0
SIDE = Region(0.0, 0.0, SIDE_M, SIDE_M)


def tracker(births_per_s=None, *, step_s=1.0) -> Bernoulli:
    reporting = Reporting(SIDE, step_s=step_s, sigma_m=0.4, p_detection=(0.8,), false_per_scan=6.0)
    return Bernoulli(Scene(reporting, Targets(births_per_s=births_per_s)))


def crowd(rng, births_per_s, *, steps, step_s=1.0):
    """Reports of each step: targets that come, walk and go, and false ones."""
    x, v = np.zeros((0, 2)), np.zeros((0, 2))
    for k in range(steps):
        born = rng.poisson(births_per_s * step_s)
        stays = rng.random(len(x)) < np.exp(-step_s / 50.0)
        x = np.concatenate([(x + step_s * v)[stays], rng.uniform(0, SIDE_M, (born, 2))])
        v = np.concatenate([v[stays], rng.normal(0.0, 0.7, (born, 2))])
        seen = x[rng.random(len(x)) < 0.8]
        seen = seen + rng.normal(0.0, 0.4, seen.shape)
        false = rng.uniform(0, SIDE_M, (rng.poisson(6.0), 2))
        z = np.concatenate([seen, false])
        yield scan(k, z)._replace(t_s=k * step_s)


def learned(one, scans):
    state, found = one.initial(), []
    for each in scans:
        state, info = one.step(state, each)
        found.append(info.learned["births_per_s"])
    return state, found


@pytest.mark.parametrize(("births_per_s", "step_s"), [(0.05, 1.0), (0.4, 1.0), (0.2, 2.0)])
def test_the_rate_of_births_is_learned(births_per_s, step_s):
    scans = crowd(np.random.default_rng(5), births_per_s, steps=250, step_s=step_s)
    _, found = learned(tracker(step_s=step_s), scans)
    count = 250 * step_s * births_per_s
    assert found[-1] == pytest.approx(births_per_s, rel=3.0 / count**0.5)


def test_births_that_are_told_are_not_learned():
    one = tracker(0.3)
    _, info = one.step(one.initial(), scan(0, [[5.0, 5.0]]))
    assert "births_per_s" not in info.learned


def test_a_burst_of_false_reports_is_no_birth():
    rng = np.random.default_rng(2)
    scans = list(crowd(rng, 0.1, steps=60))
    burst = scan(60, rng.uniform(0, SIDE_M, (400, 2)))
    after = [one._replace(t_s=one.t_s + 61) for one in crowd(rng, 0.0, steps=8)]
    _, found = learned(tracker(), [*scans, burst, *after])
    assert max(found[60:]) < found[59] + 0.005


def test_targets_that_stand_there_at_first_are_no_births():
    scans, _ = walk(np.random.default_rng(3), 8, 20, side=SIDE_M, p=1.0, false=0.0)
    _, found = learned(tracker(), scans)
    assert found[-1] < found[0] == pytest.approx(0.15)


def test_what_is_learned_survives_encoding():
    one, scans = tracker(), list(crowd(np.random.default_rng(4), 0.3, steps=40))
    state, _ = learned(one, scans[:30])
    _, expected = learned(one, scans)
    again, found = one.decode(one.encode(state)), []
    for each in scans[30:]:
        again, info = one.step(again, each)
        found.append(info.learned["births_per_s"])
    assert found == expected[30:]


def test_windows_take_the_usual_rate():
    one, known = scan(0, [[5.0, 5.0]]), Known(0.4, 0.8, 6.0)

    def birth(births_per_s):
        scene = Scene(Reporting(SIDE), Targets(births_per_s=births_per_s))
        return window(scene, [one], known=known, begins=False, paper=False).log_birth

    assert birth(None) == birth(USUAL_BIRTHS_PER_S)
