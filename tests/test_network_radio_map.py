"""The radio map: law and shadow against a dense Gaussian, and surveys as people write them."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trackfield.errors import ConfigurationError, InputError
from trackfield.network.fingerprints import Fingerprints, fingerprints_from_csv, is_fingerprints
from trackfield.network.radio_map import mean_noise, radio_map
from trackfield.network.site import Site, Target
from trackfield.network.site_file import load_site
from trackfield.network.site_writer import write_site
from trackfield.sensing.bearing import BearingModel
from trackfield.sensing.rssi import RssiModel

MODEL = RssiModel(
    power_dbm=-60.0, exponent=1.6, sigma_db=4.0, shadow_db=3.0, shadow_m=2.5, fading_db=2.0
)
SITE_TOML = """
[site]
name = "hall"
sensors_file = "sensors.csv"
survey_file = "survey.csv"
[models.ble]
kind = "rssi"
shadow_db = 3.0
[target]
height_m = 1.0
"""
SENSORS_CSV = "sensor_id,x_m,y_m,z_m\nA,0,0,2\nB,8,0,2\nC,0,6,2\n"
SURVEY_CSV = """set,sensor_id,x_m,y_m,z_m,mean_dbm,std_db,n
one,A,1,1,1,-62.5,3,100
one,B,1,1,1,-75,,
one,A,4,3,,-70,2.5,50
"""


def a_site(seed=0, rows=12, *, model=MODEL, height_m=1.0):
    rng = np.random.default_rng(seed)
    sensors = np.column_stack([rng.uniform(0, 10, (3, 2)), [2.0, 2.5, 2.0]])
    survey = Fingerprints(
        sensor=rng.integers(0, 2, rows).astype(np.int32),
        position=np.column_stack([rng.uniform(0, 10, (rows, 2)), rng.uniform(0.5, 2, rows)]),
        mean_dbm=rng.uniform(-90, -50, rows),
        std_db=np.where(rng.random(rows) < 0.5, 4.0, np.nan),
        count=np.where(rng.random(rows) < 0.5, 10.0, np.nan),
    )
    return Site(
        "hall",
        ("A", "B", "C"),
        sensors,
        (model,) * 3,
        target=Target(height_m=height_m),
        survey=survey,
    )


def dense(site, i, place):
    """Mean and variance at one place from the joint Gaussian of place and survey, written out."""
    m, survey = site.models[i], site.survey
    rows = [k for k in range(len(survey)) if survey.sensor[k] == i]
    points = [place, *(survey.position[k] for k in rows)]
    law = [
        m.power_dbm - 10 * m.exponent * math.log10(max(math.dist(p, site.positions[i]), m.near_m))
        for p in points
    ]
    K = np.array(
        [
            [m.shadow_db**2 * math.exp(-math.dist(a[:2], b[:2]) / m.shadow_m) for b in points]
            for a in points
        ]
    )
    for j, k in enumerate(rows, 1):
        std = survey.std_db[k]
        scatter = m.sigma_db**2 - m.fading_db**2 if math.isnan(std) else std**2
        count = survey.count[k]
        K[j, j] += m.fading_db**2 + (0.0 if math.isnan(count) else scatter / count)
    gain = np.linalg.solve(K[1:, 1:], K[1:, 0])
    off = survey.mean_dbm[rows] - np.array(law[1:])
    return law[0] + gain @ off, K[0, 0] - gain @ K[1:, 0]


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_the_map_is_the_conditional_of_the_joint_gaussian(seed):
    site = a_site(seed)
    places = np.random.default_rng(seed).uniform(0, 10, (4, 3))
    found = radio_map(site).expected(places)
    oracle = np.array([[dense(site, i, p) for i in range(3)] for p in places])
    # Variances of fingerprints are taken in steps of two percent.
    np.testing.assert_allclose(found.mean, oracle[..., 0], atol=0.1)
    np.testing.assert_allclose(found.variance, oracle[..., 1], rtol=0.01, atol=0.02)
    assert (found.variance >= 0.0).all()
    assert (found.variance <= MODEL.shadow_db**2 + 1e-12).all()


def test_where_nobody_has_surveyed_the_law_is_left():
    site = a_site()
    found = radio_map(site).expected(np.array([[2.0, 3.0, 1.0], [500.0, 0.0, 1.0]]))
    bare = radio_map(dataclasses.replace(site, survey=None))
    law = bare.expected(np.array([[2.0, 3.0, 1.0], [500.0, 0.0, 1.0]]))
    np.testing.assert_allclose(found.mean[1], law.mean[1])
    np.testing.assert_allclose(found.variance[1], 9.0)
    np.testing.assert_array_equal(found.mean[0, 2], law.mean[0, 2])  # C was never surveyed
    assert np.abs(found.mean[0, :2] - law.mean[0, :2]).min() > 0.1
    np.testing.assert_array_equal(law.variance, 9.0)


def test_a_place_in_the_plane_has_the_height_of_the_targets_or_none():
    place = np.array([[2.0, 3.0]])
    at_one = radio_map(a_site(height_m=1.0))
    assert at_one.expected(place).mean == pytest.approx(
        at_one.expected(np.array([[2.0, 3.0, 1.0]])).mean
    )
    flat = radio_map(a_site(height_m=None)).expected(place).mean
    nowhere = at_one.expected(np.array([[2.0, 3.0, np.nan]])).mean
    np.testing.assert_allclose(flat, nowhere)
    assert np.abs(flat - at_one.expected(place).mean).min() > 0.01


@given(st.integers(0, 2**32 - 1), st.integers(2, 3))
def test_slope_is_that_of_the_mean(seed, d):
    site = a_site(seed)
    found = radio_map(site)
    p = np.random.default_rng(seed).uniform(0, 10, (1, d))
    apart = np.abs(p[:, None, :2] - site.survey.position[:, :2]).max(-1).min()
    near = np.abs(np.linalg.norm(p[:, :2] - site.positions[:, :2], axis=1) - MODEL.near_m).min()
    h = 1e-4 * min(apart, near, 0.1)
    slope = [
        (found.expected(p + h * e).mean - found.expected(p - h * e).mean) / (2 * h)
        for e in np.eye(d)
    ]
    np.testing.assert_allclose(found.slope(p), np.stack(slope, axis=-1), atol=1e-2)


def test_receivers_that_heard_alike_share_what_is_settled():
    rng = np.random.default_rng(8)
    places = np.column_stack([rng.uniform(0, 10, (20, 2)), np.ones(20)])
    survey = Fingerprints(
        sensor=np.tile(np.arange(3, dtype=np.int32), 20),
        position=np.repeat(places, 3, axis=0),
        mean_dbm=rng.uniform(-90, -50, 60),
        std_db=rng.uniform(2.0, 4.0, 60),
        count=rng.integers(2900, 3500, 60).astype(float),
    )
    site = dataclasses.replace(a_site(), survey=survey)
    found = radio_map(site)
    assert found.receivers[0].survey is found.receivers[1].survey is found.receivers[2].survey
    for i in range(3):
        own = survey.sensor == i
        alone = Fingerprints(*(getattr(survey, f.name)[own] for f in dataclasses.fields(survey)))
        lone = radio_map(dataclasses.replace(site, survey=alone)).expected(places + 0.3)
        both = found.expected(places + 0.3)
        np.testing.assert_allclose(both.mean[:, i], lone.mean[:, i], rtol=1e-12)
        np.testing.assert_allclose(both.variance[:, i], lone.variance[:, i], rtol=1e-12)


def test_a_survey_of_exact_values_is_met_in_its_places():
    exact = dataclasses.replace(MODEL, fading_db=0.0, sigma_db=1.0)
    site = a_site(3, rows=6, model=exact)
    found = radio_map(site).expected(site.survey.position)
    own = found.mean[np.arange(6), site.survey.sensor]
    many = np.isnan(site.survey.count)
    assert np.abs(own - site.survey.mean_dbm)[many].max() < 0.1
    assert found.variance[np.arange(6), site.survey.sensor][many].max() < 0.02


def test_noise_of_a_mean_is_fading_and_what_the_readings_scatter():
    nan = np.nan
    found = mean_noise(MODEL, np.array([3.0, nan, 3.0, nan]), np.array([9.0, 4.0, nan, nan]))
    np.testing.assert_allclose(found, [5.0, 4.0 + 12.0 / 4.0, 4.0, 4.0])


def test_a_model_without_shadow_learns_nothing_from_a_survey():
    site = a_site(model=dataclasses.replace(MODEL, shadow_db=0.0))
    place = np.array([[2.0, 3.0]])
    bare = radio_map(dataclasses.replace(site, survey=None)).expected(place)
    np.testing.assert_array_equal(radio_map(site).expected(place).mean, bare.mean)
    np.testing.assert_array_equal(
        radio_map(site).slope(place), radio_map(dataclasses.replace(site, survey=None)).slope(place)
    )
    assert (bare.variance == 0.0).all()


def test_a_sensor_that_hears_no_beacon_has_no_radio_map():
    site = a_site()
    mixed = dataclasses.replace(site, models=(MODEL, BearingModel(), MODEL))
    with pytest.raises(ConfigurationError, match="sensor 'B' of kind 'bearing', expected 'rssi'"):
        radio_map(mixed)


def test_places_of_another_shape_are_refused():
    with pytest.raises(InputError, match=r"\(m, d\) with d 2 or 3"):
        radio_map(a_site()).expected(np.zeros(2))


def written(folder: Path, survey: str = SURVEY_CSV) -> Path:
    (folder / "site.toml").write_text(SITE_TOML)
    (folder / "sensors.csv").write_text(SENSORS_CSV)
    (folder / "survey.csv").write_text(survey)
    return folder / "site.toml"


def test_a_site_reads_its_survey_and_names_it_again_when_written(tmp_path):
    site = load_site(written(tmp_path))
    survey = site.survey
    assert survey is not None
    assert survey.sensor.tolist() == [0, 1, 0]
    np.testing.assert_array_equal(survey.position, [[1, 1, 1], [1, 1, 1], [4, 3, np.nan]])
    np.testing.assert_array_equal(survey.mean_dbm, [-62.5, -75.0, -70.0])
    np.testing.assert_array_equal(survey.std_db, [3.0, np.nan, 2.5])
    np.testing.assert_array_equal(survey.count, [100.0, np.nan, 50.0])
    (tmp_path / "out").mkdir()
    write_site(site, tmp_path / "out" / "again.toml")
    again = load_site(tmp_path / "out" / "again.toml")
    assert again.survey is not None
    np.testing.assert_array_equal(again.survey.mean_dbm, survey.mean_dbm)
    assert 'survey_file = "../survey.csv"' in (tmp_path / "out" / "again.toml").read_text()
    assert again.models == site.models


def test_the_survey_of_one_place_is_not_carried_to_another(tmp_path):
    site = load_site(written(tmp_path))
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "sensors.csv").write_text("sensor_id,x_m,y_m,z_m\nA,1,0,2\nB,5,0,2\n")
    write_site(site, tmp_path / "out" / "elsewhere.toml")
    assert load_site(tmp_path / "out" / "elsewhere.toml").survey is None


HEAD = "sensor_id,x_m,y_m,mean_dbm\n"


@pytest.mark.parametrize(
    ("survey", "expected"),
    [
        ("sensor_id,x_m,mean_dbm\nA,1,-60\n", "line 1: found no column 'y_m'"),
        ("", "line 1: found no column 'sensor_id'"),
        (HEAD, "found no rows"),
        (HEAD + "A,1,1,-60\nZ,1,1,-60\n", "line 3: sensor_id: found 'Z', expected a sensor"),
        (HEAD + "A,1,1,60\n", "line 2: mean_dbm: found '60', expected a strength in dBm, -200 to"),
        (HEAD + "A,1,1,nan\n", "line 2: mean_dbm: found 'nan'"),
        (HEAD + "A,1,,-60\n", "line 2: y_m: found '', expected a finite number"),
        (HEAD + "A,1,inf,-60\n", "line 2: y_m: found 'inf'"),
        (HEAD + "A,1,one,-60\n", "line 2: y_m: found 'one'"),
        (HEAD + "A,1,1\n", "line 2: found 3 cells, expected 4"),
        ("sensor_id,x_m,y_m,mean_dbm,std_db\nA,1,1,-60,-1\n", "std_db: found '-1'"),
        ("sensor_id,x_m,y_m,mean_dbm,n\nA,1,1,-60,0\n", "n: found '0', expected a number of"),
        (HEAD + "A" * 200_000 + ",1,1,-60\n", "expected comma-separated values"),
        (HEAD + "".join(f"A,{k},1,-60\n" for k in range(2001)), "found 2001 places of 'A'"),
    ],
)
def test_a_fault_of_a_survey_is_told_with_its_line(tmp_path, survey, expected):
    with pytest.raises(ConfigurationError) as caught:
        load_site(written(tmp_path, survey))
    assert any("survey.csv" in line and expected in line for line in caught.value.problems)


def test_a_survey_that_is_not_there_is_a_fault(tmp_path):
    path = written(tmp_path)
    (tmp_path / "survey.csv").unlink()
    with pytest.raises(ConfigurationError, match=r"survey_file: .*found no such file"):
        load_site(path)


def test_blank_lines_of_a_survey_are_skipped():
    found, problems = fingerprints_from_csv(HEAD + "\n , , ,\nA,1,1,-60\n", "s.csv", ("A",))
    assert (len(found), problems) == (1, [])


def test_a_file_of_fingerprints_is_known_by_its_header():
    assert is_fingerprints("set,sensor_id,x_m,y_m,z_m,n,mean_dbm,std_db,median_dbm")
    assert not is_fingerprints("t_s,sensor_id,kind,value,sigma,target_id")
