"""Which operator takes which readings, and which are not tracked together."""

from dataclasses import replace

import numpy as np
import pytest

from plain_scans import Heard, plain_site, plain_table
from trackfield.errors import ConfigurationError, InputError
from trackfield.network.kinds import KINDS
from trackfield.pipeline.dispatch import family_of, feed_of, source_of, tracker_of
from trackfield.pipeline.scanned import ScanTracker
from trackfield.pipeline.tagged import Tracker
from trackfield.sensing.angular_rate import AngularRateModel
from trackfield.sensing.motion_rate import MotionRateModel
from trackfield.sensing.range import RangeModel
from trackfield.sensing.rssi import RssiModel
from trackfield.types import Reports

SITE = replace(
    plain_site(sensors=5),
    positions=np.array(
        [[0, 0, np.nan], [10, 0, np.nan], [10, 8, np.nan], [0, 8, np.nan], [5, 9, np.nan]]
    ),
)


def of_kinds(*kinds):
    """One reading of each kind."""
    table = plain_table(SITE, [Heard(float(i), i % 5, 0.5) for i in range(len(kinds))])
    names = tuple(dict.fromkeys(kinds))
    return replace(table, kinds=names, kind=np.array([names.index(k) for k in kinds], np.int32))


@pytest.mark.parametrize("kind", KINDS)
def test_one_kind_is_of_its_own_family(kind):
    table = of_kinds(kind, kind)
    family = KINDS[kind].family
    assert family_of(table) == family
    unknown = kind in ("signal", "detection")
    assert source_of(table) == (kind if unknown else None)
    feed = feed_of(table, seed=3)
    assert (None if feed is None else feed.source) == (kind if unknown else None)


def test_directions_turn_rates_and_motion_go_together():
    assert family_of(of_kinds("motion", "bearing", "angular_rate")) == "angle"
    assert family_of(of_kinds("motion", "angular_rate")) == "angle"


def test_no_readings_are_ranges_and_reports_are_reports():
    assert family_of(of_kinds()) == "range"
    empty = np.empty(0)
    reports = Reports(empty, empty, np.empty((0, 3)), np.empty((0, 3)), empty)
    assert source_of(reports) == "reports"


@pytest.mark.parametrize(
    "kinds",
    [("bearing", "range"), ("rssi", "bearing"), ("amplitude", "energy_message"), ("rssi", "range")],
)
def test_other_kinds_do_not(kinds):
    with pytest.raises(InputError, match=f"kinds {', '.join(kinds)}, expected one kind"):
        family_of(of_kinds(*kinds))


def test_each_family_has_its_operator():
    ranges = replace(SITE, models=(RangeModel(),) * 5)
    assert isinstance(tracker_of(ranges, "range"), Tracker)
    assert isinstance(tracker_of(SITE, "angle", lag_s=1.0), ScanTracker)
    mixed = replace(SITE, models=(*SITE.models[:2], AngularRateModel(), *[MotionRateModel()] * 2))
    assert isinstance(tracker_of(mixed, "angle"), ScanTracker)
    beacons = replace(SITE, models=(RssiModel(),) * 5)
    assert isinstance(tracker_of(beacons, "rssi", every_s=0.5), ScanTracker)
    for site, family in ((SITE, "range"), (SITE, "rssi"), (beacons, "angle")):
        with pytest.raises(ConfigurationError, match="site axes"):
            tracker_of(site, family)


def test_a_beacon_of_its_own_has_its_own_models():
    strong = (RssiModel(power_dbm=-40.0),) * 5
    site = replace(SITE, models=(RssiModel(),) * 5, target_models={"x": strong})
    rows = [Heard(0.5 * k, i, -63.0, name) for k in range(20) for i in range(5) for name in "xy"]
    table = replace(plain_table(site, rows), kinds=("rssi",))
    both = tracker_of(site, "rssi").process(table)
    for name, models in (("x", strong), ("y", site.models)):
        alone = tracker_of(replace(site, models=models, target_models={}), "rssi")
        own = [z for z in rows if z.target == name]
        expected = alone.process(replace(plain_table(site, own), kinds=("rssi",)))
        rows_of = both.target == both.target_ids.index(name)
        np.testing.assert_array_equal(both.position[rows_of], expected.position)


def test_unknown_targets_have_an_operator_of_their_own():
    with pytest.raises(InputError, match="kind 'signal', whose targets have no names"):
        tracker_of(SITE, "signal")
