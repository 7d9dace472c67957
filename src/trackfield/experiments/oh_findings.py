"""What the experiments on Oh's paper say, in sentences; where a claim fails, they say so."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from trackfield.experiments.oh_fig4 import Fig4
from trackfield.experiments.oh_network import (
    CENTROIDS,
    GROUPED,
    OURS,
    PAPER,
    PAPER_CENTRAL,
    SAMPLED,
    Outcome,
)
from trackfield.experiments.oh_sweeps import Point, Sweeps
from trackfield.experiments.oh_walkers import WAYS, Walkers


def findings(
    fig4: Fig4, network: Mapping[str, Sequence[Outcome]], sweeps: Sweeps, walkers: Walkers
) -> tuple[str, ...]:
    """Say what was found on each figure and claim."""
    return (
        _fig4(fig4),
        _fusion(network),
        _hierarchy(network),
        _misplaced(sweeps),
        _loss_and_delay(sweeps),
        _moves(sweeps),
        _walkers(walkers),
    )


def gospa(network: Mapping[str, Sequence[Outcome]], name: str) -> float:
    """Mean live GOSPA [m] of a tracker over the worlds."""
    return float(np.mean([run.live.sets.gospa_m for run in network[name]]))


def _fig4(found: Fig4) -> str:
    worst = float(np.abs(found.centroid_m / found.paper_m - 1.0).max())
    gain = found.centroid_m / found.fit_m
    return (
        f"Fig. 4 comes out within {100 * worst:.1f} % of what can be read off it, if its error is "
        "the mean distance in the plane of the report nearest to one lone target. A source fit is "
        f"{gain.min():.1f} to {gain.max():.1f} times as near."
    )


def _fusion(network: Mapping[str, Sequence[Outcome]]) -> str:
    return (
        "On several targets the paper's fusion, not its tracker, is what limits the tracks: with "
        f"centroids GOSPA is {gospa(network, PAPER_CENTRAL.name):.2f} m by the paper's MCMCDA and "
        f"{gospa(network, CENTROIDS.name):.2f} m by the Bernoulli mixture; with source fits "
        f"{gospa(network, SAMPLED.name):.2f} m by MCMCDA and {gospa(network, OURS.name):.2f} m by "
        "the mixture."
    )


def _hierarchy(network: Mapping[str, Sequence[Outcome]]) -> str:
    ours = gospa(network, GROUPED.name) / gospa(network, OURS.name) - 1.0
    paper = gospa(network, PAPER.name) / gospa(network, PAPER_CENTRAL.name) - 1.0
    return (
        f"Four groups and a base against one central tracker: {100 * ours:+.1f} % GOSPA with the "
        f"mixture, {100 * paper:+.1f} % with the paper's MCMCDA."
    )


def _misplaced(sweeps: Sweeps) -> str:
    first, last = sweeps.misplaced[0], sweeps.misplaced[-1]
    said = [
        f"{name} {first.gospa_m[name].text()} m without and {last.gospa_m[name].text()} m with "
        f"{last.setting:g} spacings"
        for name in (PAPER_CENTRAL.name, OURS.name)
    ]
    held = _same(first, last, PAPER_CENTRAL.name)
    verdict = (
        "no loss can be told from chance, as the paper says"
        if held
        else "so there is a loss, which the paper does not see"
    )
    return (
        f"Misplaced sensors (the paper: no loss up to .7 spacings): {'; '.join(said)}. For the "
        f"paper's own fusion {verdict}; it has little accuracy to lose."
    )


def _loss_and_delay(sweeps: Sweeps) -> str:
    half = min(sweeps.loss, key=lambda point: abs(point.lost - 0.5))
    most = max(sweeps.delay, key=lambda point: point.delayed)
    none = sweeps.loss[0]
    ours, paper = (
        [point.gospa_m[name].value for point in (none, half, most)]
        for name in (OURS.name, PAPER_CENTRAL.name)
    )
    return (
        "The paper tolerates 50 % lost and 90 % delayed packets. Here, live GOSPA goes from "
        f"{ours[0]:.2f} m without loss to {ours[1]:.2f} m with {100 * half.lost:.0f} % lost, and "
        f"is {ours[2]:.2f} m with {100 * most.delayed:.0f} % delayed; by the paper's fusion and "
        f"tracker {paper[0]:.2f}, {paper[1]:.2f} and {paper[2]:.2f} m."
    )


def _moves(sweeps: Sweeps) -> str:
    first, last = sweeps.moves[0], sweeps.moves[-1]
    name = next(n for n in first.gospa_m if n.startswith(PAPER_CENTRAL.name))
    return (
        f"More moves do not mend the paper's tracks: {first.gospa_m[name].text()} m with "
        f"{first.setting:.0f} moves a step, {last.gospa_m[name].text()} m with {last.setting:.0f}."
    )


def _walkers(found: Walkers) -> str:
    paper, peeled, ours = WAYS
    said = ", ".join(
        f"{100 * by[ours].value:.0f} % of the runs with {count}"
        for count, by in found.right.items()
    )
    most = max(by[paper].value for by in found.right.values())
    return (
        "Walkers in the binary field, each followed under one identity from soon after its entry "
        f"to the end: track-before-detect {said}; position reports first, as in the paper, at most "
        f"{100 * most:.0f} %, and by peeling and the mixture "
        f"{100 * found.right[3][peeled].value:.0f} % with 3."
    )


def _same(one: Point, other: Point, name: str) -> bool:
    a, b = one.gospa_m[name], other.gospa_m[name]
    return a.low <= b.high and b.low <= a.high
