"""What tracking needs of sensors by what they measure: how many, and where they stand."""

import numpy as np
import pytest

from trackfield.network.needs import Needs, needs
from trackfield.network.site import Site
from trackfield.sensing.amplitude import AmplitudeModel
from trackfield.sensing.angular_rate import AngularRateModel
from trackfield.sensing.bearing import BearingModel
from trackfield.sensing.energy_message import EnergyMessageModel
from trackfield.sensing.motion_rate import MotionRateModel
from trackfield.sensing.range import RangeModel
from trackfield.sensing.rssi import RssiModel
from trackfield.sensing.signal import SignalModel

PLACES = np.array([[0.0, 0.0], [10.0, 0.0], [3.0, 8.0], [9.0, 9.0], [-5.0, 2.0]])
LINE = np.column_stack([np.arange(5.0), 2.0 * np.arange(5.0)])
B, R, M = BearingModel(), AngularRateModel(), MotionRateModel()
A, E = AmplitudeModel(sigma=0.02), EnergyMessageModel(sigma=0.02)


def field(*models, places=PLACES):
    n = len(models)
    return Site(
        "field",
        tuple(f"s{i}" for i in range(n)),
        np.column_stack([places[:n], np.full(n, np.nan)]),
        models,
    )


@pytest.mark.parametrize(
    ("site", "problem", "remark"),
    [
        (field(B), "found 1 sensors (s0), expected at least 2", None),
        (field(B, B), None, None),
        (field(B, R), None, None),
        (field(R, M), "expected at least 3 of angular_rate and motion", None),
        (field(R, R, R), None, None),
        (field(*[R] * 4, places=LINE), None, "all on one line"),
        (field(B, *[R] * 3, places=LINE), None, None),
        (field(M, M, M), None, "leave several answers at first"),
        (field(M, M, M, M, M), None, None),
        (field(*[M] * 5, places=LINE), None, "look the same for ever"),
        (field(*[R] * 3, places=LINE), None, "look the same for a while"),
        (field(R, R, M, M, places=LINE), None, "look the same for a while"),
        (field(B, R, R, R, places=LINE), None, None),
        (field(RssiModel()), "expected at least 2, and better 3", None),
        (field(RssiModel(), RssiModel()), None, "a beacon and its mirror image"),
        (field(*[RssiModel()] * 5, places=LINE), None, "all on one line"),
        (field(*[RssiModel()] * 3), None, None),
        (field(A), "expected at least 3, not in a line", None),
        (field(*[A] * 4, places=LINE), None, "both are told"),
        (field(E, E), "expected at least 3, not in a line", None),
        (field(E, E, E), None, None),
        (field(*[EnergyMessageModel()] * 3), None, "sigma = 0.1 is the default"),
        (field(A, A, AmplitudeModel()), None, "what is the noise"),
        (field(RangeModel(), RangeModel()), "expected at least 3", None),
        (field(*[SignalModel()] * 1), None, None),
        (field(RangeModel(), BearingModel()), None, None),
        (field(), None, None),
    ],
)
def test_what_is_missing_is_told(site, problem, remark):
    found = needs(site)
    assert len(found.problems) == (problem is not None)
    assert len(found.remarks) == (remark is not None)
    assert (problem or "") in "".join(found.problems)
    assert (remark or "") in "".join(found.remarks)


def test_those_that_speak_may_be_too_few():
    site = field(*[RssiModel()] * 4)
    assert needs(site, ("s1",)).problems
    assert needs(site, ("s1", "s2")).remarks
    assert needs(site, ("s1", "s2", "s3")) == Needs()
    assert not needs(field(B, R, R, R), ("s1", "s2", "s3")).problems
    assert needs(field(B, R, R, R), ("s1", "s2")).problems
