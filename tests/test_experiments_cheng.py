"""The whole reproduction of Cheng: its parts, in order, and its progress."""

import json

import numpy as np

from trackfield.experiments import cheng, cheng_example, cheng_tracking


def test_the_reproduction_is_its_parts(monkeypatch):
    small = cheng_tracking.Size(2, 1, 2, 1)
    monkeypatch.setattr(cheng_tracking, "QUICK", small)
    shares = []
    found = cheng.reproduce(np.random.default_rng(5), quick=True, progress=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    parts = cheng_example.tables(found.example), cheng_tracking.tables(found.tracking)
    assert found.tables == (*parts[0], *parts[1])
    plain = found.to_dict()
    assert plain["paper"] == "cheng"
    assert json.loads(json.dumps(plain))["findings"] == list(found.findings)
    drawn = found.figures()
    assert {"passes", "switching"} < set(drawn)
    assert len(drawn) == len(cheng_example.figures(found.example)) + 2
