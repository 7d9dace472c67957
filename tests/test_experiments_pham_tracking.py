"""Pham's chapter 2 again: the printed counts and powers, and the parts against plain twins."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trackfield.experiments import pham_masters, pham_passage, pham_tracking
from trackfield.experiments.pham_masters import Rule
from trackfield.experiments.pham_table21 import PRINTED
from trackfield.localization import trilateration
from trackfield.network import meter
from trackfield.network.energy import Energy, mode_powers
from trackfield.scheduling.master import costs
from trackfield.types import Gaussian, Mode

WAY, NODES = pham_passage.passage(), pham_passage.square()


@pytest.fixture(scope="module")
def found():
    return pham_tracking.track(np.random.default_rng(5), quick=True)


def test_counts_of_the_table_are_exact_and_powers_within_half_a_percent(found):
    for printed, here in zip(PRINTED, found.rows, strict=True):
        assert round(here.measured, 1) == printed.measured
        assert round(here.active, 1) == printed.active
        assert here.power_mw == pytest.approx(printed.power_mw, rel=0.005)
        assert here.same_ratio == pytest.approx(printed.active, rel=0.02)
        assert here.ranges_m2 < 0.7 * here.kalman_m2 < 0.2 * here.plain_m2


def test_hand_overs_with_a_margin_are_few_and_cost_no_error(found):
    wild, calm = found.hand_overs
    assert wild.reign.hand_overs > 1000
    assert calm.reign.hand_overs <= 36
    assert calm.shared_m == wild.shared_m
    assert calm.shared_m < calm.alone_m < wild.alone_m


def test_every_report_arrives_and_messages_are_a_small_part(found):
    assert len(found.services) == 4
    for one in found.services:
        assert (one.arrived, one.lost) == (150, 0)
        assert 9 < one.mean_hops < 12  # from (0, 5) to the corner, by hops of .75 m
        assert one.messages_j < 0.1 * sum(one.found.totals_j.values())
        spent = one.found.sent_bits.sum()
        assert spent == 256 * 150 * one.mean_hops + 512 * one.hand_overs


def test_error_grows_with_speed_and_with_noise(found):
    for sweep in (found.speeds, found.noises):
        assert (np.diff(sweep.kalman_m) > 0.0).all()
        assert (sweep.ranges_m < sweep.kalman_m).all()
    assert found.alone.begins.sum() > 5
    assert np.abs(found.alone.kalman - WAY.position[:, 0])[100:].max() < 1.0


def test_every_row_has_the_cells_of_its_columns_and_every_figure_is_drawn(found, tmp_path):
    for table in pham_tracking.tables(found):
        assert {len(row) for row in table.rows} == {len(table.columns)}
    said = " ".join(pham_tracking.findings(found))
    for word in ("counts", "power", "could not be recovered", "Hand-overs", "21.71"):
        assert word in said
    figures = pham_tracking.figures(found)
    assert set(figures) == {f"fig2_{n}" for n in range(4, 12)}
    figures["fig2_9"].savefig(tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size > 10_000


def test_fixes_are_those_of_the_package_cycle_by_cycle():
    rng = np.random.default_rng(1)
    nodes = pham_passage.scattered(rng)
    who = pham_passage.hearing(WAY, nodes, 0.7)
    ranges = pham_passage.measure(who, sigma_m=0.2, runs=2, rng=rng)
    found = pham_passage.trilaterate(who, ranges, sigma_m=0.2)
    heard = who.heard.sum(axis=1)
    assert (heard < 3).any()
    assert np.isnan(found.position[:, heard < 3]).all()
    for k in np.flatnonzero(heard >= 3)[::40]:
        c, T = who.place[k, who.heard[k]], WAY.position[k]
        expected = trilateration.ordinary(c, np.abs(ranges[1, k, who.heard[k]])).position
        np.testing.assert_allclose(found.position[1, k], expected, rtol=1e-7, atol=1e-7)
        Theta = trilateration.ordinary_covariance(c, T, sigma_m=0.2)
        np.testing.assert_allclose(found.covariance[k], Theta, rtol=1e-7)


def test_who_measures_and_who_is_awake_is_plain_geometry():
    zone = PRINTED[1].zone
    inside = pham_passage.awake(WAY, NODES, zone)
    who = pham_passage.hearing(WAY, NODES, 1.211)
    for k in range(0, 2000, 97):
        x, y = WAY.position[k]
        expected = [
            math.dist(node, (x, y)) <= zone.near_m
            or (
                math.dist(node, (x, y)) <= zone.far_m
                and abs(math.atan2(node[1] - y, node[0] - x)) <= math.radians(36.0)
            )
            for node in NODES.tolist()
        ]
        assert inside[k].tolist() == expected
        assert who.heard[k].sum() == sum(math.dist(n, (x, y)) <= 1.211 for n in NODES.tolist())


def test_the_filter_of_the_paper_is_a_plain_one_and_begins_anew_where_told():
    rng = np.random.default_rng(2)
    z, R = rng.normal(5.0, 1.0, 60), rng.uniform(0.01, 0.1, 60)
    z[7] = np.nan
    start = Gaussian(np.array([5.0, 0.0]), np.diag([4.0, 1.0]))
    begins = np.arange(60) == 30
    found = pham_passage.along_x(z, R, start=start, begins=begins)
    dt, q = 1 / 200, 1e-4
    for k in range(60):
        if k in (0, 30):
            x, v, a, b, c = 5.0, 0.0, 4.0, 0.0, 1.0  # covariance [[a, b], [b, c]]
        else:
            x, a, b, c = x + dt * v, a + 2 * dt * b + dt**2 * c + q, b + dt * c, c + q
        if k != 7:
            gain, e = 1.0 / (a + R[k]), z[k] - x
            x, v = x + a * gain * e, v + b * gain * e
            a, b, c = a - a * gain * a, b - a * gain * b, c - b * gain * b
        assert found[k] == pytest.approx(x, rel=1e-9)


@pytest.mark.parametrize(("margin", "battery_j"), [(0.0, 10.0), (0.2, 10.0), (0.1, 1.0)])
def test_a_reign_is_that_of_a_plain_loop(margin, battery_j):
    row = PRINTED[0]
    way = pham_passage.beginning(WAY, 800)
    rule = Rule(margin=margin, battery_j=battery_j)
    found = pham_masters.reign(way, NODES, measuring_m=0.576, zone=row.zone, rule=rule)
    awake, energy = pham_passage.awake(way, NODES, row.zone), Energy()
    left, master, hand_overs, forced = [1.0] * 441, -1, 0, 0
    for k, T in enumerate(way.position):
        apart = np.hypot(*(NODES - T).T)
        able = [i for i in range(441) if apart[i] <= row.zone.near_m and left[i] > 0]
        W = {i: float(costs(apart[i] / row.zone.near_m, left[i], alpha=0.2)) for i in able}
        best = min(able, key=W.__getitem__, default=-1)
        before = master
        if master not in able or W[best] < W[master] - margin:
            master = best
        changed = -1 not in (before, master) and before != master
        hand_overs, forced = hand_overs + changed, forced + (changed and before not in able)
        assert found.master[k] == master
        power = mode_powers(energy, (apart <= 0.576).sum())
        for i in range(441):
            mode = Mode.SENSING if apart[i] <= 0.576 else Mode(int(awake[k, i]))
            joules = power[Mode.MASTER if i == master else mode] * 1e-3 / 200
            joules += 512e-6 * (5.6 * (i == before) + 4.0 * (i == master)) if changed else 0.0
            left[i] = max(left[i] - joules / battery_j, 0.0)
    assert (found.hand_overs, found.forced) == (hand_overs, forced)
    np.testing.assert_allclose(found.residual, left, rtol=1e-9, atol=1e-12)
    assert found.begins.sum() == np.count_nonzero(np.diff(found.master))
    assert found.messages_j == pytest.approx(hand_overs * 512 * 9.6e-6)


def test_the_meter_counts_what_masters_spent_cycle_by_cycle():
    """The residuals that the choice goes by are those of the commands, but for hand-overs."""
    row, rule = PRINTED[0], Rule(margin=0.2, battery_j=1000.0)
    told = {"measuring_m": 0.576, "zone": row.zone}
    found = pham_masters.reign(WAY, NODES, **told, rule=rule)
    commands = pham_masters.commands(WAY, NODES, **told, masters=found.master)
    start = meter.init(Energy(), commands.sensor_ids, battery_j=1000.0)
    metered, _ = meter.step(start, 10.0, commands=commands)
    # The meter lets a master receive from those that sense beside it; Pham counts itself too.
    heard = (pham_passage.distances(WAY, NODES) <= 0.576).sum(axis=1)
    himself = np.zeros(441)
    for k in range(2000):
        m = found.master[k]
        others = heard[k] - (np.hypot(*(NODES[m] - WAY.position[k])) <= 0.576)
        himself[m] += (heard[k] - others) * 1.0 / 200
    expected = 1000.0 * (1.0 - found.residual) - metered.spent_j.sum(axis=1) - himself
    assert expected.sum() == pytest.approx(found.messages_j, rel=1e-6)
    assert (np.abs(expected) <= found.messages_j).all()
