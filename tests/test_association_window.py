"""Windows as the scene sees them, and identities that tracks keep."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from report_worlds import REGION, SCENE, scan
from trackfield.association.identity import identities, renamed
from trackfield.association.model import Targets
from trackfield.association.window import Known, life_time_s, window
from trackfield.raster import Raster

KNOWN = Known(0.4, 0.73, 6.0)
SCANS = [scan(t, [[20.0, 20.0], [80.0, 30.0]], first=2 * t) for t in range(4)]


def view(scene=SCENE, scans=SCANS, *, begins=False, paper=False):
    return window(scene, scans, known=KNOWN, begins=begins, paper=paper)


def test_densities_are_per_area_and_old_targets_thin_out_from_the_windows_start():
    w = view()
    area, survival = REGION.area, np.exp(-1 / 50)
    np.testing.assert_allclose(np.exp(w.log_false), 6.0 / area)
    standing = (
        0.1
        * 50.0
        * np.array([1.0, 0.27, 0.27**2, 0.27**3])[w.slot]
        * survival ** np.maximum(w.slot - 1, 0)
    )
    np.testing.assert_allclose(np.exp(w.log_birth) * area, 0.1 + standing)


def test_the_start_of_the_run_has_its_own_count_of_targets():
    w = view(begins=True)
    assert np.exp(w.log_birth[0]) * REGION.area == pytest.approx(0.1 + 1.0)


def test_paper_mode_has_births_alone_and_charges_a_death_once():
    w = view(paper=True)
    np.testing.assert_allclose(np.exp(w.log_birth) * REGION.area, 0.1)
    assert w.life.region is None
    assert np.exp(w.life.log_death) == pytest.approx(1 - np.exp(-1 / 50))
    assert view().life.log_death is None


def test_maps_of_births_false_alarms_and_detection_hold_where_a_report_is():
    left = Raster(REGION, np.array([[3.0, 1.0]]))
    scene = replace(
        SCENE,
        reporting=replace(
            SCENE.reporting, false_map=left, p_detection=(Raster(REGION, np.array([[0.9, 0.5]])),)
        ),
        targets=Targets(birth_map=left),
    )
    w = view(scene, paper=True)
    np.testing.assert_allclose(np.exp(w.log_birth[:2]) * REGION.area, [0.15, 0.05])
    np.testing.assert_allclose(np.exp(w.log_false[:2]) * REGION.area, [9.0, 3.0])
    np.testing.assert_allclose(w.p_detection[1], [0.9, 0.5] * 4)


def test_detection_goes_by_the_age_of_the_slot():
    scene = replace(SCENE, reporting=replace(SCENE.reporting, p_detection=(0.2, 0.5, 0.7)))
    np.testing.assert_allclose(view(scene).p_detection[:, 0], [0.7, 0.7, 0.5, 0.2])


def test_impossible_probabilities_are_kept_off_zero_and_one():
    scene = replace(
        SCENE, reporting=replace(SCENE.reporting, p_detection=(0.0, 1.0), false_per_scan=0.0)
    )
    w = view(scene)
    assert ((w.p_detection > 0) & (w.p_detection < 1)).all()
    assert np.isfinite(w.log_false).all()


def test_survival_goes_by_the_time_between_scans():
    w = view(scans=[scan(0, []), scan(1, []), scan(3.5, [])])
    np.testing.assert_allclose(w.survival, np.exp([0.0, -1 / 50, -2.5 / 50]))


def test_a_hazard_counts_by_its_mean_life():
    assert life_time_s(Targets(lifetime_s=30.0), 2.0) == 30.0
    assert life_time_s(Targets(hazard=(0.1,)), 2.0) == pytest.approx(20.0)
    hazard = (0.5, 0.2, 0.1)
    ages = np.arange(1, 2000)
    alive = np.cumprod(np.where(ages <= 3, np.array(hazard)[np.minimum(ages, 3) - 1], 0.1) * -1 + 1)
    assert life_time_s(Targets(hazard=hazard), 1.0) == pytest.approx(1.0 + alive.sum())


def test_tracks_keep_the_name_that_most_of_their_reports_had():
    owner = np.array([0, 0, 0, 1, 1, 2, 2, -1])
    before = np.array([7, 7, 4, 4, 4, 0, 0, 4])
    names, following = identities(owner, before, next_track=9)
    np.testing.assert_array_equal(names, [7, 4, 9])
    assert following == 10
    np.testing.assert_array_equal(renamed(owner, before, names), [7, 7, 7, 4, 4, 9, 9, 0])


def test_two_halves_of_a_track_do_not_share_its_name():
    names, following = identities(np.array([0, 0, 0, 1, 1]), np.array([3] * 5), next_track=4)
    np.testing.assert_array_equal(names, [3, 4])
    assert following == 5


def test_a_dissolved_tracks_report_brings_its_name_back():
    owner, before = np.array([-1, -1, 0, 0]), np.array([5, 5, 6, 6])
    names, following = identities(owner, before, next_track=7)
    kept = renamed(owner, before, names)
    np.testing.assert_array_equal(kept, [5, 5, 6, 6])
    names, _ = identities(np.array([0, 0, 1, 1]), kept, next_track=following)
    np.testing.assert_array_equal(names, [5, 6])


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(st.integers(-1, 4), st.integers(0, 6)), max_size=30))
def test_names_are_never_used_twice(rows):
    owner = np.array([k for k, _ in rows], int)
    used = {k: i for i, k in enumerate(sorted(set(owner[owner >= 0])))}
    owner = np.array([used.get(k, -1) for k in owner], int)
    before = np.array([name for _, name in rows], int)
    names, following = identities(owner, before, next_track=7)
    assert len(set(names.tolist())) == len(names) == len(used)
    assert all(1 <= name < following for name in names)
