"""The dissertation as a whole: every chapter's tables, findings and figures come together."""

import numpy as np
import pytest

from trackfield.experiments import pham

FIGURES = ("fig2_4", "fig2_5", "fig2_11", "fig3_4", "fig3_5")


@pytest.fixture(scope="module")
def found():
    shares = []
    result = pham.reproduce(np.random.default_rng(0), quick=True, progress=shares.append)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    return result


def test_every_chapter_has_its_tables(found):
    titles = " ".join(table.title for table in found.tables)
    for name in ("Table 2.1", "Fig. 3.4", "Fig. 3.5", "Figs. 3.6-3.8", "Figs. 4.7-4.9", "Fig. 5.5"):
        assert name in titles
    for table in found.tables:
        assert {len(row) for row in table.rows} == {len(table.columns)}
    assert found.to_dict()["paper"] == "pham"
    assert len(found.findings) > 10


def test_figures_have_names_of_their_own(found):
    drawn = found.figures()
    assert len(drawn) == sum(len(draw()) for draw in found.drawn)
    assert set(FIGURES) <= set(drawn)
