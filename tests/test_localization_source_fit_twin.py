"""The compiled search for sources against its plain twin: the same sources, to rounding."""

import math
from dataclasses import replace

import numpy as np
import pytest

from source_scenes import OH, ROUGH, grid
from sources_twin import Twin
from trackfield.localization import source_fit
from trackfield.localization.source_settings import settings_for
from trackfield.sensing import signal

SMALL = grid(14)
STRANGE = replace(OH, exponent=2.6, falloff=0.6, sigma=0.7, amplitude=120.0, max_range_m=6.0)
CASES = {
    "exact": OH,
    "rough": ROUGH,
    "rough, one strength": replace(ROUGH, sigma_factor=0.0),
    "the strongest hides the others": replace(OH, combination="max"),
    "strongest, rough": replace(ROUGH, combination="max"),
    "saturated": replace(OH, saturation=40.0),
    "another law": STRANGE,
    "misplaced": replace(OH, placement_sigma_m=0.4),
}


def scan(seed, model, *, k=3, field=SMALL):
    """A few targets, some near each other; a broken sensor; some that do not speak."""
    rng = np.random.default_rng(seed)
    targets = rng.uniform(1.0, field.max() - 1.0, (k, 2))
    factors = np.exp(model.sigma_factor * rng.standard_normal(k))
    z = signal.simulate(model, field, targets=targets, rng=rng, factors=factors)
    if seed % 2:
        z[rng.integers(len(z))] = rng.choice([90.0, 0.0, -40.0])
        z[rng.random(len(z)) < 0.05] = math.nan
    return z


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("seed", range(4))
def test_the_kernel_finds_what_its_twin_finds(name, seed):
    model = CASES[name]
    z = scan(seed, model)
    settings = settings_for(model, SMALL)
    found = source_fit.locate(model, SMALL, values=z, settings=settings)
    twin = Twin(model, SMALL, z, settings)
    plain = twin.run()
    assert len(found.position) == len(plain)
    places = np.array([one.source.place for one in plain]).reshape(-1, 2)
    np.testing.assert_allclose(found.position, places, atol=1e-5)
    for row, one in enumerate(plain):
        (xx, xy), (_, yy) = one.covariance
        np.testing.assert_allclose(found.covariance[row], [xx, xy, yy], rtol=1e-3, atol=1e-10)
        strength = model.amplitude * math.exp(one.source.log_factor)
        assert found.amplitude[row] == pytest.approx(strength, rel=1e-5)
        assert found.gain[row] == pytest.approx(one.gain, rel=1e-5, abs=1e-4)
        assert found.misfit[row] == pytest.approx(one.misfit, rel=1e-4)
        assert found.leader[row] == twin.numbers[one.source.leader]
    assert found.suspects.tolist() == twin.suspects()


@pytest.mark.parametrize("spacing_m", [2.0, 4.0])
def test_wide_fields_too(spacing_m):
    field = grid(10, spacing_m)
    for seed in (2, 4):
        z = scan(seed, OH, field=field, k=4)
        found = source_fit.locate(OH, field, values=z)
        plain = Twin(OH, field, z, settings_for(OH, field)).run()
        places = np.array([one.source.place for one in plain]).reshape(-1, 2)
        np.testing.assert_allclose(found.position, places, atol=1e-5)
