"""Example 5.1 of Cheng: the window keeps the paper's promise, its own steps often do not."""

import numpy as np
import pytest

from trackfield.experiments import cheng_example
from trackfield.experiments.cheng_example import EACH, GRADIENT, SIGMAS, TOLD, WINDOW
from trackfield.sensing import motion_vector


@pytest.fixture(scope="module")
def found():
    return cheng_example.run(np.random.default_rng(51), quick=True)


def test_a_window_is_within_10_cm_in_every_run_and_the_papers_steps_are_not(found):
    for runs in found.passes.values():
        assert all(one.worst_m(WINDOW) < 0.03 for one in runs)
    noisy = found.passes[SIGMAS[-1]]
    assert any(one.worst_m(GRADIENT) > 0.1 for one in noisy)


def test_four_sensors_have_several_exact_states_and_six_have_one(found):
    four, five, six = found.moments
    assert four.states.mean() > 3.0
    assert five.states.mean() < four.states.mean()
    assert (six.states == 1.0).all()
    assert all(m.found.all() for m in found.moments)


def test_the_landscape_is_least_where_the_robot_is(found):
    at = found.landscape
    i, j = np.argmin(np.abs(at.y_m - at.truth[1])), np.argmin(np.abs(at.x_m - at.truth[0]))
    near = at.root_error[i - 1 : i + 2, j - 1 : j + 2].min()
    assert near < np.quantile(at.root_error, 0.02)
    seen = motion_vector.sighting(cheng_example.RECTANGLE, at.truth)
    b = motion_vector.scalar_output(seen)
    place = np.array([at.x_m[10], at.y_m[30]])
    errors = [
        np.sum(
            motion_vector.scalar_residual(
                motion_vector.sighting(
                    cheng_example.RECTANGLE, np.array([*place, s * np.cos(a), s * np.sin(a)])
                ),
                b,
            ).value
            ** 2
        )
        for a in np.linspace(0, np.pi, 60)
        for s in np.linspace(0.0, 1.0, 60)
    ]
    assert at.root_error[30, 10] == pytest.approx(np.sqrt(min(errors)), rel=0.05)


def test_tables_findings_and_figures_tell_it(found):
    passes, moments = cheng_example.tables(found)
    assert len(passes.rows) == 4 * len(SIGMAS)
    assert [row[1] for row in passes.rows[:4]] == [GRADIENT, TOLD, EACH, WINDOW]
    assert len(moments.rows) == 3
    assert all("nan" not in sentence for sentence in cheng_example.findings(found))
    assert set(cheng_example.figures(found)) == {
        "fig1_square_error",
        "fig2_velocities",
        "fig3_trajectory",
    }
