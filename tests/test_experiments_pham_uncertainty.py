"""Pham, Fig. 3.4 and closed forms: known traces, measured errors, and what the tables say."""

import numpy as np
import pytest

from trackfield.experiments import pham_uncertainty as experiment


@pytest.fixture(scope="module")
def found():
    return experiment.run(np.random.default_rng(1), quick=True)


def test_the_path_goes_through_the_known_traces(found):
    (there,) = np.flatnonzero(np.isclose(found.x, 0.9))
    golden = [12.837630397029349, 12.701845573843551, 1.2593351080882484]
    np.testing.assert_allclose(found.traces["#1, 2, 4-6"][there], golden, rtol=1e-9)
    for along in found.traces.values():
        assert (along[:, 0] >= along[:, 1] - 1e-9).all()
        assert (along[:, 1] >= along[:, 2] - 1e-9).all()


def test_measured_errors_are_those_of_the_formulas(found):
    """Chi-square of 300 draws in two axes: within four standard deviations of each trace."""
    (there,) = np.flatnonzero(np.isclose(found.x, 0.9))
    for name, measured in found.measured.items():
        np.testing.assert_allclose(
            measured / found.traces[name][there], 1.0, atol=4.0 * np.sqrt(2.0 / found.draws)
        )


def test_only_unweighted_differences_get_worse_by_a_node(found):
    assert found.grown.rises[0] > 0.0
    assert found.grown.rises[1:].tolist() == [0.0, 0.0]
    assert found.grown.worst[0] > 1.0
    assert (found.grown.worst[1:] <= 1.0 + 1e-9).all()


def test_tables_stand_beside_the_paper(found):
    traces, third, rings, space = experiment.tables(found)
    for table in (traces, third, rings, space):
        assert {len(row) for row in table.rows} == {len(table.columns)}
    assert third.rows[0] == ("30", "8.00", "8.54", "15: 7.81", "105: 1.42")
    assert rings.rows[-1] == ("150", "2.93", "2.07", "7.73")
    assert space.rows[-1][1] == space.rows[-1][2] != space.rows[0][1] != space.rows[0][2]
    assert traces.rows[0][2] == "1.49 at 0.90"


def test_findings_say_what_is_wrong_and_what_is_unknown(found):
    text = " ".join(experiment.findings(found))
    for words in ("neither the path nor the values", "7.81", "1.42", "BLUE in 0.0 %", "reversed"):
        assert words in text


def test_figures_are_drawn(found):
    figures = experiment.figures(found)
    assert set(figures) == {"fig3_4", "fig3_4_map", "third_sensor"}
    assert [len(figure.axes) for figure in figures.values()] == [3, 4, 1]
