"""What Wang's experiments gave, as tables beside the paper's claims, and in words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from trackfield.experiments import wang_contest as contest
from trackfield.experiments.results import Interval, Row, Table
from trackfield.experiments.wang_roads import (
    ADDITIVE,
    EKF,
    IEKF,
    LAGGED,
    LIVE,
    MLE,
    PAPER,
    ROBUST,
    SAFE,
    THREE,
    Outcome,
)
from trackfield.simulation.roads import End

TESTBED = "testbed"
TESTBED_BETTER = "testbed, better noise"
MATCHED = "matched"
BAD_START = "bad start"
ROADS: dict[End, str] = {"D": "A-B-D", "C": "A-B-C"}
CLAIMED: Mapping[str, Mapping[str, str]] = {
    "A-B-D": {EKF: "15.12", MLE: "17.19"},
    "A-B-C": {EKF: "14.87", MLE: "31.19"},
}
"""By how many percent the paper says that its filter is better than these, Wang 4.3."""

BOUND = "PCRB of the model"


class Score(NamedTuple):
    """How a filter fared in a part: RMSE per axis [m] and NEES, mean (None: it has none).

    `gain` is by how many percent the paper's filter is better, run by run.
    """

    rmse: Interval
    gain: Interval
    nees: float | None = None

    def to_dict(self) -> dict[str, object]:
        """Give the score as plain objects."""
        return {"rmse": self.rmse._asdict(), "gain": self.gain._asdict(), "nees": self.nees}


Scores = Mapping[str, Mapping[str, Score]]


def score(outcomes: Mapping[str, Outcome], rng: np.random.Generator) -> dict[str, dict[str, Score]]:
    """Score every filter of every part, with 95 % intervals by a paired bootstrap over runs."""
    scores: dict[str, dict[str, Score]] = {}
    for part, outcome in outcomes.items():
        ours = outcome.entries[PAPER].square
        picks = contest.picks(rng, ours.size)
        scores[part] = {
            name: Score(
                contest.rmse(entry.square, picks),
                contest.gain(ours, entry.square, picks),
                entry.nees,
            )
            for name, entry in outcome.entries.items()
        }
        least = np.full(ours.shape, (outcome.bound**2).mean())
        scores[part][BOUND] = Score(contest.rmse(least, picks), contest.gain(ours, least, picks))
    return scores


def tables(scores: Scores) -> tuple[Table, ...]:
    """Make all tables."""
    everyone = (PAPER, EKF, MLE, ADDITIVE, THREE, IEKF)
    return (
        _testbed(scores),
        *(_road(scores, road) for road in ROADS.values()),
        Table(
            "The same with the motion of the model: RMSE, honesty",
            ("filter", "RMSE [m]", "95 %", "of the bound", "KF+MLE better by [%]", "95 %", "NEES"),
            tuple(
                (*_error(s, name), f"{_share(s, name):.3f}", *_better(s, name), _nees(s, name))
                for s in (scores[MATCHED],)
                for name in (*everyone, BOUND)
            ),
        ),
        Table(
            "First position wrong by 2 m on each axis, motion of the model",
            ("filter", "RMSE [m]", "95 %", "of the bound", "NEES"),
            tuple(
                (*_error(s, name), f"{_share(s, name):.3f}", _nees(s, name))
                for s in (scores[BAD_START],)
                for name in (PAPER, SAFE, EKF, IEKF, BOUND)
            ),
        ),
        _blocked(scores),
    )


def findings(scores: Scores) -> tuple[str, ...]:
    """Say what the tables show: what the paper's 15 % depends on."""

    def gain(part: str, name: str) -> str:
        return f"{scores[part][name].gain.value:.1f} %"

    def rmse(part: str, name: str) -> str:
        return f"{scores[part][name].rmse.value:.4f} m"

    def ratio(part: str, name: str) -> str:
        return f"{scores[part][name].rmse.value / scores[part][PAPER].rmse.value:.2f}"

    d, c = ROADS.values()
    return (
        "An EKF update is a Kalman update on one Gauss-Newton step of prelocalization. So against "
        f"a correct EKF the paper's filter gains {gain(MATCHED, EKF)} where its model holds, "
        f"{gain(d, EKF)} on {d} and {gain(c, EKF)} on {c}; the paper says 15.12 and 14.87 %.",
        "About 15 % appears against an EKF that is not told of the multiplicative noise "
        f"({gain(MATCHED, ADDITIVE)} where the model holds, {gain(d, ADDITIVE)} on {d}) or that "
        f"hears three sensors only ({gain(MATCHED, THREE)}, {gain(d, THREE)}).",
        f"The gain over MLE alone is real: {gain(MATCHED, MLE)} where the model holds, "
        f"{gain(d, MLE)} on {d}, {gain(c, MLE)} on {c}.",
        "What iterating buys is bad starts: 2 m wrong on each axis, the safeguarded KF+MLE has "
        f"{rmse(BAD_START, SAFE)}, the iterated EKF {rmse(BAD_START, IEKF)}, the EKF "
        f"{rmse(BAD_START, EKF)}; the bound is {rmse(BAD_START, BOUND)}.",
        f"The default tracker, which knows neither start nor motion, has {ratio(c, LIVE)} of the "
        f"RMSE of the paper's filter on {c} live and {ratio(c, LAGGED)} ten steps later; with 10 % "
        f"of the ranges blocked {ratio(blocked(c), LIVE)} and {ratio(blocked(c), LAGGED)}.",
    )


def blocked(road: str) -> str:
    """Name the part of a road where ranges are blocked."""
    return f"{road}, blocked"


def _testbed(scores: Scores) -> Table:
    paper, better = scores[TESTBED], scores[TESTBED_BETTER]
    return Table(
        "4.2 Testbed: two circles, four sensors",
        ("filter", "RMSE [m], Q 0.0027", "95 %", "RMSE [m], Q 0.0003", "95 %"),
        tuple((*_error(paper, name), *_error(better, name)[1:]) for name in (PAPER, EKF, MLE)),
    )


def _road(scores: Scores, road: str) -> Table:
    s = scores[road]
    names = (PAPER, EKF, MLE, ADDITIVE, THREE, IEKF, LIVE, LAGGED, BOUND)
    return Table(
        f"4.3 Road {road}, round the corner",
        ("filter", "RMSE [m]", "95 %", "KF+MLE better by [%]", "95 %", "paper says [%]"),
        tuple(
            (*_error(s, name), *_better(s, name), CLAIMED[road].get(name, "-")) for name in names
        ),
    )


def _blocked(scores: Scores) -> Table:
    """Both roads, clean and blocked, against the paper's filter on the same readings."""
    rows: list[Row] = []
    for name in (PAPER, EKF, ROBUST, LIVE, LAGGED):
        row = [name]
        for road in ROADS.values():
            for part in (road, blocked(road)):
                found = scores[part].get(name)
                row.append("-" if found is None else f"{found.rmse.value:.4f}")
        rows.append(tuple(row))
    columns = [text for road in ROADS.values() for text in (road, blocked(road))]
    return Table(
        "10 % of ranges blocked, late by Exp(1 m): RMSE [m]", ("filter", *columns), tuple(rows)
    )


def _error(scores: Mapping[str, Score], name: str) -> Row:
    found = scores[name].rmse
    interval = "-" if name == BOUND else f"{found.low:.4f} to {found.high:.4f}"
    return name, f"{found.value:.4f}", interval


def _better(scores: Mapping[str, Score], name: str) -> Row:
    if name == PAPER:
        return "-", "-"
    found = scores[name].gain
    return f"{found.value:.1f}", f"{found.low:.1f} to {found.high:.1f}"


def _share(scores: Mapping[str, Score], name: str) -> float:
    return scores[name].rmse.value / scores[BOUND].rmse.value


def _nees(scores: Mapping[str, Score], name: str) -> str:
    found = scores[name].nees
    return "-" if found is None else f"{found:.2f}"
