"""Time of a trajectory from twenty messages, against one search of SciPy from the truth."""

import time

import numpy as np
import pytest
from scipy.optimize import least_squares

from pass_scene import NOISY, PASS, TIMES, drawn
from trackfield.localization.pass_fusion import PassSettings, fuse
from trackfield.sensing import profile as profiles
from trackfield.sensing.pass_profile import predict

pytestmark = pytest.mark.speed


def least(*ways, repeats=15):
    """Least processor time of each way, interleaved."""
    best = [np.inf] * len(ways)
    for _ in range(repeats):
        for i, way in enumerate(ways):
            before = time.process_time()
            way()
            best[i] = min(best[i], time.process_time() - before)
    return best


def test_all_modes_of_twenty_messages_cost_less_than_one_search_of_scipy():
    noisy = drawn(np.random.default_rng(0), n=20, model=NOISY)
    told = profiles.expected(profiles.profile_of(noisy.profiles), TIMES)

    def search():
        def residuals(theta):
            return (profiles.expected(predict(theta, noisy.sensors), TIMES) - told).ravel()

        least_squares(residuals, PASS, method="lm", x_scale="jac")

    default, everything, scipy = least(
        lambda: fuse(noisy),
        lambda: fuse(noisy, settings=PassSettings(starts="all")),
        search,
    )
    assert scipy > 4.0 / 1.5 * default
    assert everything < 1.5 * 6.0 * default
