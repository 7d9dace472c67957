"""Chapter 5 in its quick form: the counts of the paper, the order of policies, what is shown."""

import numpy as np
import pytest

from trackfield.experiments.pham_lifetime import figures, findings, run, tables


@pytest.fixture(scope="module")
def found():
    return run(np.random.default_rng(5), quick=True)


def test_elimination_leaves_about_as_many_nodes_as_in_the_paper(found):
    e = found.elimination
    assert e.before.mean() == pytest.approx(24.3, rel=0.25)
    assert e.after.mean() == pytest.approx(6.1, abs=1.5)
    assert (e.tried <= e.sets_after).all()


def test_the_bound_costs_something_and_ranks_little(found):
    c = found.choice
    assert c.bounded.trace <= 0.03
    assert c.bounded.cost >= c.cheapest.cost
    assert (found.ranks.excess >= -1e-12).all()
    assert found.ranks.excess.mean() < 0.02


def test_nobody_passes_the_bounds(found):
    lives = found.lives
    for name, death in lives.death.items():
        assert (death <= lives.death_bound).all(), name
        assert (lives.failed[name] >= lives.failed_bound).all(), name
    assert lives.death["cost"].mean() > lives.death["geometry"].mean()


def test_what_is_found_is_told_and_drawn(found):
    _, counts, lives = tables(found)
    assert len(counts.rows) == 5
    assert lives.rows[-1][0] == "nobody beyond"
    assert all(len(row) == len(lives.columns) for row in lives.rows)
    assert "Theorem 5.1 is false" in " ".join(findings(found))
    assert set(figures(found)) == {"fig5_2", "fig5_3", "fig5_4", "fig5_5", "lifetimes"}
