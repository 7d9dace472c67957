"""Maps of accuracy: each cell is the bound there, whatever the blocks; known cases; errors."""

import math
import time
from dataclasses import replace

import numpy as np
import pytest

from trackfield.errors import InputError
from trackfield.localization.information import (
    fisher_information,
    position_bound,
    site_bound,
    site_gains,
)
from trackfield.network.site import Site, Target
from trackfield.raster import Region
from trackfield.scheduling import accuracy
from trackfield.scheduling.accuracy import accuracy_map, by_name, summary
from trackfield.scheduling.selection import select
from trackfield.sensing import detection
from trackfield.sensing.angular_rate import AngularRateModel
from trackfield.sensing.bearing import BearingModel
from trackfield.sensing.detection import DetectionModel
from trackfield.sensing.range import RangeModel
from trackfield.sensing.signal import SignalModel

REGION = Region(-1.0, 0.0, 11.0, 8.0)
KINDS = (
    RangeModel(sigma_m=0.1, sigma_scale=0.02, max_range_m=4.0),
    BearingModel(max_range_m=3.0),
    SignalModel(amplitude=30.0, max_range_m=5.0),
    AngularRateModel(max_range_m=6.0),
    DetectionModel(radius_m=3.0, edge_m=1.0),
    DetectionModel(radius_m=4.0, heading_deg=30.0, width_deg=90.0),
)


def site(seed=0, n=30, models=KINDS, **target):
    rng = np.random.default_rng(seed)
    places = rng.uniform([-1, 0, 0], [11, 8, 2], (n, 3))
    return Site(
        name="field",
        sensor_ids=tuple(map(str, range(n))),
        positions=places,
        models=tuple(models[i % len(models)] for i in range(n)),
        target=Target(**target),
    )


CASES = {
    "plane": (site(), {}, ()),
    "height": (site(1, height_m=1.0), {}, ()),
    "told height": (site(2), {"height_m": 0.5}, ()),
    "space": (site(3, dimensions=3), {"height_m": 1.0}, (1.0,)),
    "moving": (site(4), {"velocity_m_s": np.array([1.0, -0.5])}, (1.0, -0.5)),
    "moving in space": (
        site(5, dimensions=3),
        {"height_m": 1.0, "velocity_m_s": np.array([1.0, -0.5, 0.1])},
        (1.0, 1.0, -0.5, 0.1),
    ),
    "one range": (site(6, n=1), {}, ()),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("pairs", [1, 50, 1 << 16])
def test_each_cell_is_the_bound_there_whatever_the_blocks(case, pairs, monkeypatch):
    monkeypatch.setattr(accuracy, "_PAIRS", pairs)
    field, options, rest = CASES[case]
    found = accuracy_map(field, REGION, cell_m=1.0, **options)
    centres = found.rms_m.centres()
    states = np.column_stack([centres, np.tile(rest, (len(centres), 1))])
    height = options.get("height_m") if field.target.dimensions == 2 else None
    bound = site_bound(field, states, height_m=height)
    trace = np.trace(bound.covariance, axis1=1, axis2=2)
    np.testing.assert_array_equal(found.determined.values.ravel(), bound.determined)
    some = bound.determined
    assert some.any() == (case != "one range")
    np.testing.assert_allclose(found.trace_m2.values.ravel()[some], trace[some], rtol=1e-6)
    np.testing.assert_allclose(found.rms_m.values.ravel()[some], np.sqrt(trace[some]), rtol=1e-6)
    roots, axes = np.linalg.eigh(bound.covariance[some, :2, :2])
    np.testing.assert_allclose(found.major_m.values.ravel()[some] ** 2, roots[:, 1], rtol=1e-6)
    np.testing.assert_allclose(found.minor_m.values.ravel()[some] ** 2, roots[:, 0], rtol=1e-4)
    angle = found.angle_rad.values.ravel()[some]
    assert (angle >= 0.0).all()
    assert (angle < math.pi).all()
    along = np.abs(np.cos(angle) * axes[:, 0, 1] + np.sin(angle) * axes[:, 1, 1])
    np.testing.assert_allclose(along[roots[:, 1] > 1.01 * roots[:, 0]], 1.0, atol=1e-6)


def test_sensors_in_reach_are_counted_region_by_region():
    field = site(7)
    found = accuracy_map(field, REGION, cell_m=0.5)
    centres = found.covered.centres()
    count = np.zeros(len(centres))
    for place, model in zip(field.positions[:, :2], field.models, strict=True):
        if isinstance(model, DetectionModel):
            depth = detection.depth(model, place[None], positions=centres)[:, 0]
            count += depth >= -0.5 * model.edge_m
        else:
            count += np.linalg.norm(centres - place, axis=1) <= model.max_range_m
    np.testing.assert_array_equal(found.covered.values.ravel(), count)
    assert np.ptp(count) > 5
    told = summary(found)
    assert told.covered == (count.min(), pytest.approx(count.mean()), count.max())


def test_of_equal_ranges_the_dilution_is_the_error_over_sigma():
    field = site(8, n=12, models=(RangeModel(sigma_m=0.3, scale=0.1, max_range_m=6.0),))
    found = accuracy_map(field, REGION, cell_m=1.0)
    there = found.determined.values > 0
    np.testing.assert_allclose(
        found.dilution.values[there], found.rms_m.values[there] * 1.1 / 0.3, rtol=1e-9
    )
    halved = replace(field, models=tuple(replace(m, sigma_m=0.15) for m in field.models))
    better = accuracy_map(halved, REGION, cell_m=1.0)
    np.testing.assert_allclose(better.dilution.values, found.dilution.values)
    np.testing.assert_allclose(better.rms_m.values[there], found.rms_m.values[there] / 2)


def test_the_best_three_are_chosen_cell_by_cell():
    field = site(9, n=15, models=KINDS[:3])
    every = accuracy_map(field, REGION, cell_m=2.0)
    best = accuracy_map(field, REGION, cell_m=2.0, choose=lambda gains: select(gains, 3).sensors)
    centres = every.rms_m.centres()
    for cell, (trace, determined) in enumerate(
        zip(best.trace_m2.values.ravel(), best.determined.values.ravel(), strict=True)
    ):
        if not determined:
            continue
        gains = site_gains(field, centres[cell])
        expected = position_bound(fisher_information(gains[select(gains, 3).sensors]))
        assert trace == pytest.approx(np.trace(expected.covariance), rel=1e-6)
    there = every.determined.values > 0
    assert (best.determined.values[there] == 1.0).all()
    assert (best.rms_m.values[there] >= every.rms_m.values[there] * (1 - 1e-9)).all()
    assert (best.rms_m.values[there] > every.rms_m.values[there] * 1.1).any()
    np.testing.assert_array_equal(best.covered.values, every.covered.values)


def test_where_a_direction_is_free_it_says_so_and_tables_have_no_value():
    line = site(10, n=2, models=(RangeModel(),))
    line = replace(line, positions=np.array([[0.0, 4.5, np.nan], [10.0, 4.5, np.nan]]))
    found = accuracy_map(line, REGION, cell_m=1.0)
    rows = found.determined.values.all(axis=1)
    assert rows.tolist() == [True] * 4 + [False] + [True] * 3
    assert np.isfinite(found.rms_m.values).all()
    assert (found.rms_m.values[4] > 1e3).all()
    told = by_name(found)
    assert list(told)[:2] == ["trace_m2", "rms_m"]
    assert np.isnan(told["rms_m"].values[4]).all()
    assert np.isfinite(told["covered"].values).all()
    few = summary(found)
    assert few.undetermined == pytest.approx(1 / 8)
    rms = found.rms_m.values[found.determined.values > 0]
    assert few.rms_m == pytest.approx((np.median(rms), np.quantile(rms, 0.95), rms.max()))
    alone = accuracy_map(site(11, n=1, models=(RangeModel(),)), REGION, cell_m=1.0)
    assert summary(alone) == (1.0, None, (1, 1.0, 1))


@pytest.mark.parametrize(
    ("field", "options", "words"),
    [
        (site(), {"region": Region(0, 0, 0, 1)}, "sides above 0"),
        (site(), {"region": Region(0, 0, math.inf, 1)}, "finite sides"),
        (site(), {"cell_m": 0.0}, "cell_m: found 0.0"),
        (site(), {"cell_m": 1e-6}, "cells in the region"),
        (site(), {"cell_m": math.nan}, "cell_m: found nan"),
        (site(dimensions=3), {}, "the site is in space"),
        (site(), {"velocity_m_s": np.zeros(3)}, r"expected \(2,\)"),
    ],
)
def test_what_cannot_be_mapped_is_refused(field, options, words):
    arguments = {"region": REGION, "cell_m": 1.0, **options}
    region = arguments.pop("region")
    with pytest.raises(InputError, match=words):
        accuracy_map(field, region, **arguments)


@pytest.mark.speed
def test_time_grows_with_what_is_in_reach_and_not_with_the_field():
    """10,000 sensors on 250 x 250 cells cost no more than 25 maps of 400 on 50 x 50."""

    def field(n, side):
        rng = np.random.default_rng(12)
        places = np.column_stack([rng.uniform(0, side, (n, 2)), np.full(n, np.nan)])
        models = (RangeModel(sigma_m=0.1, max_range_m=8.0),) * n
        return Site("field", tuple(map(str, range(n))), places, models), Region(0, 0, side, side)

    def cost(n, side):
        place, region = field(n, side)
        start = time.process_time()
        found = accuracy_map(place, region, cell_m=1.0)
        assert found.rms_m.values.shape == (side, side)
        return time.process_time() - start

    small, large = (min(cost(*size) for _ in range(2)) for size in ((400, 50), (10_000, 250)))
    assert large < 1.5 * 25 * small
