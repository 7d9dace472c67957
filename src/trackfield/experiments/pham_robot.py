"""Pham, chapter 4: the robot that follows the target, Figs. 4.7-4.9; its way and the shortest."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trackfield.experiments.pham_robot_loop import (
    ERROR_M,
    SIGMA_M,
    Loop,
    Setting,
    run_loop,
    typical_error,
)
from trackfield.experiments.pham_robot_paths import (
    SENSING_M,
    Ratios,
    Wandering,
    on_sinusoids,
    without_period,
)
from trackfield.experiments.results import Table
from trackfield.robot.sink import (
    Traffic,
    master_traffic,
    relays,
    robot_traffic,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LOOPS = (2.0, 2.5, 4.0)  # ranges of Figs. 4.7 and 4.8
_SINK = np.zeros(2)


class PhamRobot(NamedTuple):
    """Everything of chapter 4; `tables`, `findings` and `figures` tell it.

    `loops` are closed-loop runs, by the rule and with foresight at each range; `traffic` what the
    nodes send there at a range of 2.5: with a robot that has a radio to the sink, with one that has
    none, and without a robot.
    """

    ratios: tuple[Ratios, ...]
    wandering: tuple[Wandering, ...]
    loops: tuple[Loop, ...]
    traffic: tuple[Traffic, Traffic, Traffic]


def robot(rng: np.random.Generator, *, quick: bool = False) -> PhamRobot:
    """Run all of chapter 4; `quick` with 2 tracks of a kind where the full run takes 12."""
    runs = 2 if quick else 12
    tracks, walks, seed = rng.spawn(3)
    first = int(seed.integers(2**32))
    loops = [
        run_loop(np.random.default_rng(first), Setting(comm, ahead=ahead))  # the same nodes for all
        for comm in _LOOPS
        for ahead in (False, True)
    ]
    middle = next(one for one in loops if one.setting == Setting(2.5, ahead=True))
    return PhamRobot(
        tuple(on_sinusoids(tracks, runs=runs)),
        tuple(without_period(walks, runs=runs)),
        tuple(loops),
        _traffic(middle),
    )


def tables(found: PhamRobot) -> tuple[Table, ...]:
    """Tell ways over the optimum, ways without a period, closed-loop runs, and traffic."""
    ratios = tuple(
        (
            f"{one.noise_m:g}",
            f"{one.range_m:g}",
            f"{one.rule.mean():.3f}",
            f"{one.ahead.mean():.3f}",
            f"{one.ahead.max():.3f}",
        )
        for one in found.ratios
    )
    walks = tuple(
        (one.kind, f"{one.ratio.mean():.3f}", f"{one.ratio.max():.3f}") for one in found.wandering
    )
    loops = tuple(
        (
            f"{one.setting.comm_m:g}",
            "ahead" if one.setting.ahead else "rule",
            f"{one.length_m:.2f}",
            f"{one.optimum_m:.2f}",
            f"{100.0 * one.hop_kept:.1f}",
            f"{typical_error(one.filtered, one.target):.3f}",
            f"{typical_error(one.trilaterated, one.target):.3f}",
        )
        for one in found.loops
    )
    names = ("robot with a radio to the sink", "robot, reports over the nodes", "no robot: masters")
    traffic = tuple((name, *map(str, one)) for name, one in zip(names, found.traffic, strict=True))
    return (
        Table(
            "Chapter 4: way of the robot over the shortest there is, sinusoids across the field",
            ("noise [m]", "tau_C", "rule (4.11)", "looking ahead", "worst run"),
            ratios,
        ),
        Table(
            "Paths without a period: way looking ahead over that of the rule",
            ("path", "mean", "worst"),
            walks,
        ),
        Table(
            "Figs. 4.7-4.9, closed loop: three ranges a step, 441 random nodes",
            (
                "tau_C",
                "robot",
                "way [m]",
                "shortest [m]",
                "hop kept [%]",
                "filter median [m]",
                "trilateration median [m]",
            ),
            loops,
        ),
        Table(
            "Messages times hops that nodes send, at tau_C = 2.5",
            ("who tracks", "readings", "hand-overs", "reports", "steps unreported"),
            traffic,
        ),
    )


def findings(found: PhamRobot) -> tuple[str, ...]:
    """Say what was found, and what could not be recovered."""
    by_noise = {
        noise: [one for one in found.ratios if one.noise_m == noise]
        for noise in sorted({one.noise_m for one in found.ratios})
    }
    ahead = ", ".join(
        f"{max(one.ahead.mean() for one in rows):.3f} with {noise:g} m noise"
        for noise, rows in by_noise.items()
    )
    rule = [float(one.rule.mean()) for one in found.ratios if one.noise_m == 0.0]
    worst = max(float(one.ratio.mean()) for one in found.wandering)
    own, over, masters = found.traffic
    first = found.loops[0]
    rough, smooth = (typical_error(of, first.target) for of in (first.trilaterated, first.filtered))
    kept = min(one.hop_kept for one in found.loops)
    return (
        "Fig. 4.7-4.8: the robot moves like the target and less, as printed. The rule (4.11) keeps "
        f"each step short, not the way: on exact tracks it goes {min(rule):.2f} to {max(rule):.2f} "
        f"times the shortest way, by range. Looking ahead goes, at the worst range, {ahead}; noise "
        "makes the discs themselves shake.",
        f"Without a period there is nothing to foretell: {worst:.3f} times the rule's way at the "
        "worst kind of path, and never more than one reach longer.",
        "Closed loop: all sensors that sense the target hear the robot in "
        f"{100.0 * kept:.1f} % of the steps at least, with {ERROR_M} m for the filter's error.",
        f"Fig. 4.9: trilateration of three ranges errs {rough:.2f} m, the filter {smooth:.2f} m "
        f"(medians), at {SIGMA_M} m noise of a range; now and then three sensors in a line leave "
        "trilateration metres off, but not the filter, for which they are selected.",
        f"The claim that a robot spares hand-overs and messages to the sink holds: {own.total} "
        f"messages times hops against {masters.total} by masters without one; {over.total} if it "
        "has no radio of its own to the sink and its reports travel over the nodes.",
        "Not printed, so not recovered: period, amplitude and speed of the sinusoid, the sensing "
        f"range (here {SENSING_M}), the noise, the error dtau_T, the lengths of the ways; the "
        "car's speed and wheel base play no part in its figures.",
    )


def figures(found: PhamRobot) -> dict[str, Figure]:
    """Draw Figs. 4.7-4.9 and the ways over the optimum, by file name without its suffix."""
    from trackfield.experiments import pham_robot_figures  # deferred: Matplotlib is optional

    return pham_robot_figures.figures(found)


def _traffic(loop: Loop) -> tuple[Traffic, Traffic, Traffic]:
    net = relays(loop.nodes, _SINK, hop_m=loop.setting.comm_m)
    return (
        robot_traffic(net, loop.robot, loop.selected, radio=True),
        robot_traffic(net, loop.robot, loop.selected, radio=False),
        master_traffic(net, loop.master, loop.selected),
    )
