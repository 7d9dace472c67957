"""Binary fields calibrated from one walk with truth: recovery, errors, broken nodes, clock."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import expit, logit
from scipy.stats import beta

from trackfield.calibration.detection_fit import (
    Evidence,
    RateFit,
    evidence,
    fit_rates,
    sensor_rates,
)
from trackfield.calibration.detection_search import Geometry, search
from trackfield.calibration.detection_site import calibrate_detection_site, detection_run
from trackfield.calibration.detections import (
    DetectionCalibration,
    DetectionRun,
    calibrate_detections,
)
from trackfield.calibration.truth_paths import paths_at
from trackfield.errors import ConfigurationError, InputError
from trackfield.network.channel import Channel
from trackfield.network.site import Group, ReportSettings, Site
from trackfield.sensing import detection
from trackfield.sensing.detection import DetectionModel
from trackfield.sensing.range import RangeModel
from trackfield.types import Readings, Truth, select_rows

GRID = np.stack(np.meshgrid(5.0 * np.arange(12), 5.0 * np.arange(12)), axis=-1).reshape(-1, 2)
STEPS = 75
TOLD = DetectionModel()  # what the site says; the world differs


class World(NamedTuple):
    model: DetectionModel = TOLD
    delivery: float = 0.9
    broken: int = 6
    clock_s: float = 0.0
    walkers: int = 1


def walk(rng: np.random.Generator) -> np.ndarray:
    """Walk across the field at about 1.2 m/s, meandering."""
    t = np.arange(STEPS) - STEPS / 2
    turn = rng.uniform(0, 2 * np.pi)
    u = np.array([np.cos(turn), np.sin(turn)])
    aside = 6 * np.sin(2 * np.pi * t / 50 + rng.uniform(0, 6))
    middle = 27.5 + rng.uniform(-12, 12, 2)
    return middle + 1.2 * t[:, None] * u + aside[:, None] * np.array([-u[1], u[0]])


def make(world: World, seed: int) -> tuple[DetectionRun, np.ndarray]:
    """Make a run, and which nodes are alive."""
    rng = np.random.default_rng(seed)
    paths = np.stack([walk(rng) for _ in range(world.walkers)], axis=1)
    alive = np.ones(len(GRID), bool)
    alive[rng.choice(len(GRID), world.broken, replace=False)] = False
    drawn = detection.simulate(
        world.model, GRID, paths=paths, rng=rng, delivery=world.delivery, alive=alive
    )
    t = np.arange(float(STEPS))
    k = world.walkers
    run = DetectionRun(
        t_s=t - world.clock_s,
        detected=drawn.received,
        sensors=GRID,
        truth_s=np.repeat(t, k),
        target=np.tile(np.arange(k, dtype=np.int32), STEPS),
        position=paths.reshape(-1, 2),
    )
    return run, alive


def learn(world: World, seed: int, **options: Any) -> DetectionCalibration:
    return calibrate_detections(make(world, seed)[0], delivery=world.delivery, **options)


@pytest.mark.parametrize(
    "model",
    [
        DetectionModel(radius_m=6.5),
        DetectionModel(p_detection=0.5, p_false=0.1),
        DetectionModel(radius_m=9.0, edge_m=3.0),
    ],
)
def test_one_walk_tells_radius_and_rates_within_their_errors(model):
    deviations = []
    for seed in range(4):
        found = learn(World(model), seed, clock=False)
        one, errors = found.pooled, found.errors
        assert one.radius_m == pytest.approx(model.radius_m, rel=0.06)
        assert one.p_detection == pytest.approx(model.p_detection, abs=0.12)
        assert one.p_false == pytest.approx(model.p_false, abs=0.015)
        assert one.edge_m == pytest.approx(model.edge_m, abs=2.0)
        deviations.append(
            [
                (getattr(one, name) - getattr(model, name)) / getattr(errors, name)
                for name in ("radius_m", "p_detection", "p_false")
            ]
        )
    rms = np.sqrt(np.mean(np.square(deviations), axis=0))
    assert (rms > 0.15).all()
    assert (rms < 2.0).all()


def test_the_clock_of_the_truth_is_found_or_left_alone():
    model = DetectionModel(radius_m=6.5)
    for offset in (-1.2, 0.8):
        found = learn(World(model, clock_s=offset), 0)
        assert found.clock_offset_s == pytest.approx(offset, abs=0.3)
        assert 0.02 < found.clock_error_s < 0.2
        assert found.pooled.radius_m == pytest.approx(6.5, rel=0.04)
        assert found.used < found.given == STEPS
    still = learn(World(model), 0)
    assert still.clock_offset_s == 0.0
    assert still.used == STEPS


def test_dead_and_babbling_nodes_are_told_from_quiet_ones():
    run, alive = make(World(walkers=3), 5)
    babbler = int(np.flatnonzero(alive)[40])
    detected = run.detected.copy()
    detected[:, babbler] = np.random.default_rng(0).random(STEPS) < 0.9
    found = calibrate_detections(replace(run, detected=detected), delivery=0.9, clock=False)
    health = np.array([one.health for one in found.sensors])
    assert health[babbler] == "babbling"
    assert not (alive & (health == "dead")).any()
    assert (health[~alive] == "dead").sum() >= 4
    assert set(health[~alive]) <= {"dead", "unsure"}
    assert (health[alive] == "alive").mean() > 0.9
    assert found.pooled.p_false == pytest.approx(0.05, abs=0.01)  # it does not spoil the others'
    quiet = found.sensors[int(np.flatnonzero(~alive)[0])]
    assert quiet.detections == 0
    assert quiet.p_detection == pytest.approx(found.pooled.p_detection, abs=0.05)


def test_loss_that_is_not_told_ends_up_in_the_rates():
    """What the receiver sees of p and q is delivery p and delivery q."""
    run, _ = make(World(delivery=0.6), 3)
    told = calibrate_detections(run, delivery=0.6, clock=False).pooled
    seen = calibrate_detections(run, clock=False).pooled
    assert seen.p_detection == pytest.approx(0.6 * told.p_detection, rel=0.02)
    assert seen.p_false == pytest.approx(0.6 * told.p_false, rel=0.02)
    assert seen.radius_m == pytest.approx(told.radius_m, rel=0.005)


def test_sensors_that_report_silence_show_their_loss_themselves():
    run, alive = make(World(delivery=1.0), 4)
    heard = np.random.default_rng(1).random(run.detected.shape) < 0.7
    heard[:, 0] = False
    found = calibrate_detections(replace(run, heard=heard), clock=False)
    assert found.pooled.p_detection == pytest.approx(0.7, abs=0.1)
    assert found.pooled.p_false == pytest.approx(0.05, abs=0.01)
    np.testing.assert_allclose(found.heard_share[1:].mean(), 0.7, atol=0.02)
    assert found.sensors[0].health == "unsure" or not alive[0]
    assert found.sensors[0].detections == 0


def test_sectors_are_scaled_and_polygons_keep_their_shape():
    sector = DetectionModel(radius_m=7.0, heading_deg=90.0, width_deg=120.0)
    room = DetectionModel(polygon=((-4.0, -4.0), (4.0, -4.0), (4.0, 4.0), (-4.0, 4.0)))
    models = [sector, room] * 72
    rng = np.random.default_rng(2)
    run, _ = make(World(walkers=2), 2)
    paths = run.position.reshape(STEPS, 2, 2)
    drawn = detection.simulate(detection.columns(models), GRID, paths=paths, rng=rng)
    told = [replace(sector, radius_m=5.0), room] * 72
    found = calibrate_detections(replace(run, detected=drawn.received), told, clock=False)
    assert found.models[0].radius_m == pytest.approx(7.0, rel=0.05)
    assert found.models[0].heading_deg == pytest.approx(90.0)
    assert found.models[0].width_deg == pytest.approx(120.0)
    assert found.models[1].polygon == room.polygon
    assert found.models[1].p_detection == pytest.approx(0.7, abs=0.12)


class Drawn(NamedTuple):
    coverage: np.ndarray
    detected: np.ndarray

    def evidence(self, sensors: slice = slice(None)) -> Evidence:
        z = self.detected[:, sensors]
        return evidence(
            self.coverage[:, :, sensors],
            z,
            heard=np.ones(z.shape, bool),
            delivery=np.full(z.shape[1], 0.9),
        )


def draw(rng: np.random.Generator, p: np.ndarray, *, q: float) -> Drawn:
    shape = (400, 2, p.size)
    c = (rng.random(shape) < 0.15) * rng.uniform(0.3, 1.0, shape)
    hit = 1 - np.prod(1 - p * c, axis=1) + q * np.prod(1 - c, axis=1)
    return Drawn(c, rng.random(hit.shape) < 0.9 * hit)


def test_rates_are_those_of_a_general_optimiser():
    """The same likelihood written out sensor by sensor, maximised by SciPy."""
    drawn = draw(np.random.default_rng(3), np.full(8, 0.6), q=0.08)
    drawn.detected[:, 0] = False
    drawn.detected[:, 1] = np.random.default_rng(8).random(400) < 0.6

    def cost(x):
        p, q = expit(x)
        total = 0.0
        for i in range(8):
            c = drawn.coverage[:, :, i]
            one = 1 - (1 - p * c[:, 0]) * (1 - p * c[:, 1])
            P = 0.9 * (one + q * (1 - c[:, 0]) * (1 - c[:, 1]))
            z = drawn.detected[:, i]
            alive = np.log(0.94) + np.log(np.where(z, P, 1 - P)).sum()
            k = int(z.sum())
            babbling = np.log(0.01) + _log_beta(k + 1, 400 - k + 1)
            dead = np.log(0.05) if k == 0 else -np.inf
            total += np.logaddexp.reduce([alive, dead, babbling])
        return -total

    best = minimize(cost, [0.0, -2.0], method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-9})
    found = fit_rates(drawn.evidence())
    np.testing.assert_allclose([found.p, found.q], expit(best.x), rtol=2e-3)
    assert found.log_likelihood == pytest.approx(-best.fun, abs=1e-3)
    assert found.dead[0] > 0.999
    assert found.babbling[1] > 0.999
    np.testing.assert_allclose(found.alive + found.dead + found.babbling, 1.0)
    h = 1e-3
    hessian = np.array(
        [
            [
                sum(s * r * cost(best.x + h * (s * a + r * b)) for s in (1, -1) for r in (1, -1))
                for b in np.eye(2)
            ]
            for a in np.eye(2)
        ]
    ) / (4 * h * h)
    scale = np.sqrt(np.diag(hessian))
    np.testing.assert_allclose(
        found.information / np.outer(scale, scale), hessian / np.outer(scale, scale), atol=0.15
    )


def _log_beta(a: float, b: float) -> float:
    return -float(beta.logpdf(0.5, a, b)) + (a + b - 2) * np.log(0.5)


def test_sensors_that_differ_get_their_own_rates_and_alike_ones_share_theirs():
    rng = np.random.default_rng(4)
    p = np.linspace(0.3, 0.9, 30)
    unlike = draw(rng, p, q=0.05).evidence()
    rates, errors = sensor_rates(unlike, fit_rates(unlike))
    z = (rates[:, 0] - p) / errors[:, 0]
    assert 0.6 < np.sqrt(np.mean(z**2)) < 1.5
    assert 0.75 < np.polyfit(p, rates[:, 0], 1)[0] < 1.05  # shrunk, but hardly
    alike = draw(rng, np.full(30, 0.6), q=0.05)
    shared, _ = sensor_rates(alike.evidence(), fit_rates(alike.evidence()))
    own = [fit_rates(alike.evidence(slice(i, i + 1))).p for i in range(30)]
    assert np.ptp(shared[:, 0]) < 0.5 * np.ptp(own)


def test_paths_between_samples_gaps_and_absence():
    truth_s = np.array([0.0, 1.0, 2.0, 6.0, 7.0, 3.0, 5.0])
    target = np.array([0, 0, 0, 0, 0, 4, 4], np.int32)
    x = np.array([0.0, 2.0, 4.0, 8.0, 9.0, 1.0, 1.0])
    t = np.array([-1.0, 0.5, 3.5, 6.5, 7.5])
    found = paths_at(truth_s, target, position=np.stack([x, -x], axis=1), t_s=t)
    np.testing.assert_array_equal(found.known, [False, True, False, True, False])
    np.testing.assert_allclose(found.position[1, 0], [1.0, -1.0])
    np.testing.assert_allclose(found.speed[[1, 3], 0], np.sqrt(2) * np.array([2.0, 1.0]))
    assert np.isnan(found.position[[0, 4], 0]).all()
    assert np.isnan(found.position[[1, 3], 1]).all()
    assert found.speed[2, 1] == 0.0


def test_one_row_of_truth_is_a_target_at_one_instant():
    found = paths_at(
        np.array([1.0]), np.zeros(1, np.int32), position=np.ones((1, 2)), t_s=np.array([1.0, 2.0])
    )
    np.testing.assert_array_equal(found.known, [True, False])
    np.testing.assert_array_equal(found.position[0, 0], [1.0, 1.0])


def test_who_stands_still_is_left_out_and_a_run_of_standing_is_refused():
    run, _ = make(World(), 6)
    standing = run.position.copy()
    standing[20:40] = standing[20]
    found = calibrate_detections(replace(run, position=standing), clock=False)
    assert found.used == STEPS - 19
    with pytest.raises(InputError, match="nobody moves"):
        calibrate_detections(replace(run, position=np.tile(standing[20], (STEPS, 1))))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"t_s": np.arange(74.0)}, r"detected: found shape \(75, 144\), expected \(74, 144\)"),
        ({"sensors": np.zeros((144, 3))}, r"sensors: found shape \(144, 3\)"),
        ({"heard": np.ones((75, 3), bool)}, r"heard: found shape \(75, 3\)"),
        ({"target": np.zeros(3, np.int32)}, "target: found shape"),
        ({"position": np.full((75, 2), np.nan)}, "position: found a value that is not a number"),
        ({"truth_s": np.arange(75.0) + 1e4}, "found 0 steps of detections with truth beside them"),
        ({"sensors": GRID + 1e3}, "found 0 times a target inside a sensor's region"),
        ({"detected": np.zeros((75, 144), bool)}, "found no detection beside truth"),
        (
            {
                "truth_s": np.empty(0),
                "target": np.empty(0, np.int32),
                "position": np.empty((0, 2)),
            },
            "truth: found no rows",
        ),
    ],
)
def test_a_run_that_cannot_be_used_is_refused(change, words):
    run, _ = make(World(), 7)
    with pytest.raises(InputError, match=words):
        calibrate_detections(replace(run, **change))


def test_wrong_models_and_delivery_are_refused(monkeypatch):
    run, _ = make(World(), 7)
    with monkeypatch.context() as small:
        small.setattr("trackfield.calibration.detections._MOST_PAIRS", 10_000)
        with pytest.raises(InputError, match="found 75 steps of 144 sensors and 1 targets"):
            calibrate_detections(run)
    with pytest.raises(ConfigurationError, match="radius_m"):
        calibrate_detections(run, DetectionModel(radius_m=-1.0))
    with pytest.raises(InputError, match="models: found 2, expected one or 144"):
        calibrate_detections(run, [TOLD, TOLD])
    for delivery in (0.0, 1.1, np.nan):
        with pytest.raises(InputError, match="delivery: found"):
            calibrate_detections(run, delivery=delivery)


def tables(run: DetectionRun, *, silence: bool = False) -> tuple[Readings, Truth]:
    """Make tables of a run; where `silence` is sent, rows of 0 too."""
    step, sensor = np.nonzero(np.ones_like(run.detected) if silence else run.detected)
    n = step.size
    readings = Readings(
        t_s=run.t_s[step] + 0.3 * np.sin(np.arange(n)),
        sensor=sensor.astype(np.int32),
        value=run.detected[step, sensor].astype(float),
        target=np.full(n, -1, np.int32),
        kind=np.zeros(n, np.int32),
        sigma=np.full(n, np.nan),
        arrival_s=np.full(n, np.nan),
        sensor_ids=tuple(f"s{i}" for i in range(len(GRID))),
        target_ids=(),
        kinds=("detection",),
    )
    position = np.column_stack([run.position, np.full(len(run.position), np.nan)])
    return readings, Truth(run.truth_s, run.target, position, ("walker",))


def field_site(**options: Any) -> Site:
    return Site(
        name="field",
        sensor_ids=(*(f"s{i}" for i in range(len(GRID))), "radar"),
        positions=np.column_stack([np.vstack([GRID, [0.0, 0.0]]), np.zeros(len(GRID) + 1)]),
        models=(*(TOLD for _ in GRID), RangeModel()),
        **options,
    )


def test_a_site_is_calibrated_from_tables_and_told_of_its_loss_by_its_network():
    run, _ = make(World(DetectionModel(radius_m=6.5)), 8)
    site = field_site(network=Channel(p_loss=0.1))
    found = calibrate_detection_site(site, *tables(run), clock=False)
    plain = calibrate_detections(run, delivery=0.9, clock=False)
    assert found.calibration.pooled.radius_m == pytest.approx(plain.pooled.radius_m, rel=0.01)
    assert found.calibration.pooled.p_detection == pytest.approx(plain.pooled.p_detection, rel=0.02)
    assert found.sensor_ids == site.sensor_ids[:-1]
    assert found.site.models[:-1] == found.calibration.models
    assert found.site.models[-1] == RangeModel()
    unaware = calibrate_detection_site(field_site(), *tables(run), clock=False)
    seen = unaware.calibration.pooled.p_detection
    assert seen == pytest.approx(0.9 * found.calibration.pooled.p_detection, rel=0.02)


def test_rows_of_zero_say_that_silence_is_reported():
    run, _ = make(World(delivery=1.0, broken=0), 9)
    readings, truth = tables(run, silence=True)
    kept = np.random.default_rng(0).random(len(readings)) < 0.8
    found = detection_run(field_site(), select_rows(readings, kept), truth)
    assert found.heard is not None
    np.testing.assert_array_equal(found.heard.ravel(), kept)
    np.testing.assert_array_equal(found.detected, run.detected & found.heard)
    later = detection_run(field_site(), replace(readings, t_s=readings.t_s + 20.4), truth)
    np.testing.assert_allclose(later.t_s, 20.4 + np.arange(75), atol=0.01)
    np.testing.assert_array_equal(later.detected, run.detected)
    slow = field_site(reports=ReportSettings(step_s=5.0))
    assert detection_run(slow, readings, truth).t_s.size == 16


def test_tables_that_do_not_fit_the_site_are_refused():
    run, _ = make(World(), 9)
    readings, truth = tables(run)
    with pytest.raises(InputError, match="no sensor of kind 'detection'"):
        detection_run(replace(field_site(), models=(RangeModel(),) * 145), readings, truth)
    with pytest.raises(InputError, match="no reading of kind 'detection'"):
        detection_run(field_site(), replace(readings, kinds=("range",)), truth)
    empty = select_rows(replace(readings, kinds=()), np.empty(0, int))
    with pytest.raises(InputError, match="no reading of kind 'detection'"):
        detection_run(field_site(), empty, truth)
    strange = replace(readings, sensor_ids=("radar", *readings.sensor_ids[1:]))
    with pytest.raises(InputError, match="'radar', which is no binary sensor"):
        detection_run(field_site(), strange, truth)
    far = replace(readings, t_s=readings.t_s * 1e6)
    with pytest.raises(InputError, match="expected at most 1000000"):
        detection_run(field_site(), far, truth)


def test_a_node_that_nobody_hears_is_calibrated_as_silent():
    run, _ = make(World(), 8)
    site = field_site(network=Channel(hop_m=6.0, p_loss=0.1), groups=(Group("g", 300.0, 300.0),))
    found = calibrate_detection_site(site, *tables(run), clock=False)
    assert found.calibration.pooled.p_detection < 0.8


def bell(size: float, sigma: float, *, offset_s: float = 0.0, offset_sigma: float = np.inf) -> Any:
    """Profile likelihood that is a Gaussian of size and offset, whatever the edge."""

    def profile(at: Geometry, start: RateFit | None) -> RateFit:
        log_likelihood = -0.5 * ((at.size - size) / sigma) ** 2
        log_likelihood -= 0.5 * ((at.offset_s - offset_s) / offset_sigma) ** 2
        none = np.empty(0)
        return RateFit(0.5, 0.1, np.eye(2), log_likelihood, none, none, none)

    return profile


@pytest.mark.parametrize(("size", "sigma"), [(1.3, 0.02), (0.5, 0.005), (2.2, 0.1)])
def test_the_search_gives_the_moments_of_a_known_posterior(size, sigma):
    found = search(bell(size, sigma), clock=None)
    assert found.geometry.size == pytest.approx(size, abs=0.1 * sigma)
    assert found.errors.size == pytest.approx(sigma, rel=0.1)
    assert found.errors.offset_s == np.inf
    # All edges alike: the mean and spread of a flat density over them.
    assert found.geometry.edge == pytest.approx(0.31, abs=0.05)


@pytest.mark.parametrize("offset", [-2.4, 0.05, 1.1])
def test_the_search_finds_a_known_offset_or_none(offset):
    profile = bell(1.1, 0.05, offset_s=offset, offset_sigma=0.2)
    found = search(profile, clock=profile)
    assert found.errors.offset_s == pytest.approx(0.2, rel=0.01)
    expected = offset if abs(offset) > 0.6 else 0.0
    assert found.geometry.offset_s == pytest.approx(expected, abs=1e-6)
    untold = search(bell(1.1, 0.05), clock=bell(1.1, 0.05))
    assert untold.geometry.offset_s == 0.0
    assert untold.errors.offset_s > 1e3


@pytest.mark.parametrize(("p", "q"), [(0.97, 0.4), (0.1, 0.01), (0.5, 0.3), (0.95, 0.002)])
def test_rates_far_from_the_usual_are_found(p, q):
    given = draw(np.random.default_rng(6), np.full(12, p), q=q).evidence()
    found = fit_rates(given)
    error = np.sqrt(np.diag(np.linalg.inv(found.information)))
    assert abs(logit(found.p) - logit(p)) < 3.5 * error[0]
    assert abs(logit(found.q) - logit(q)) < 3.5 * error[1]
    assert found.alive.min() > 0.9


def test_a_start_at_which_all_nodes_look_broken_is_not_used():
    given = draw(np.random.default_rng(7), np.full(12, 0.7), q=0.05).evidence()
    usual = fit_rates(given)
    lost = usual._replace(p=0.999, q=0.9, alive=np.zeros(12))
    for start in (usual, usual._replace(p=0.4, q=0.1), lost):
        found = fit_rates(given, start)
        assert found.p == pytest.approx(usual.p, abs=2e-3)
        assert found.q == pytest.approx(usual.q, abs=2e-3)
