"""Oh, Fig. 10: many targets in a field of signal sensors over a network that loses and delays.

100 x 100 sensors a metre apart, R_s 8, four tier-2 nodes, hops of 11.5 m (the paper does not give
R_s; with these, its counts of messages come out). Reports are made where signals are heard and then
travel; a run is tracked online, each step with what has arrived by then.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from trackfield.association.bernoulli import Bernoulli
from trackfield.association.contract import AnyAssociator
from trackfield.association.mcmcda import Mcmcda
from trackfield.association.model import Scene
from trackfield.association.sampling import Sampling
from trackfield.hierarchy.field import tracked_field
from trackfield.metrics.many import ManyScore, score_many
from trackfield.network.channel import Channel
from trackfield.network.passage import Passed
from trackfield.network.site import Group, Site
from trackfield.pipeline.scene import scene
from trackfield.pipeline.untagged import Feed, UntaggedTracker
from trackfield.raster import Raster
from trackfield.sensing.signal import SignalModel
from trackfield.simulation.hearing import all_of, carry_reports, hear_reports
from trackfield.simulation.scenario import Party, Scenario, Sensors
from trackfield.simulation.told_site import site_of
from trackfield.simulation.world import World, make_world, stream
from trackfield.types import Matrix, Reports, Tracks, Truth, join_rows

LEADERS = ((25.0, 25.0), (75.0, 25.0), (25.0, 75.0), (75.0, 75.0))
CENTROID_SIGMA_M = 1.2  # per axis, what the paper's fusion really has (its Fig. 4 says .03)
_CENTROID_P = 0.73  # share of targets that the paper's fusion reports
Fusion = Literal["fit", "centroid"]
FUSIONS: tuple[Fusion, ...] = ("fit", "centroid")


class Tracker(NamedTuple):
    """Who tracks: by which reports and method, in how many groups, with which effort."""

    name: str
    fusion: Fusion
    method: Literal["bernoulli", "mcmcda", "paper"]
    grouped: bool = False
    moves: int = 1000


PAPER = Tracker("paper: centroids, MCMCDA in 4 groups", "centroid", "paper", grouped=True)
PAPER_CENTRAL = Tracker("centroids, the paper's MCMCDA", "centroid", "paper")
CENTROIDS = Tracker("centroids, Bernoulli mixture", "centroid", "bernoulli")
SAMPLED = Tracker("source fits, MCMCDA of ours", "fit", "mcmcda")
OURS = Tracker("source fits, Bernoulli mixture", "fit", "bernoulli")
GROUPED = Tracker("the same in 4 groups", "fit", "bernoulli", grouped=True)
CONTEST = (PAPER, PAPER_CENTRAL, CENTROIDS, SAMPLED, OURS, GROUPED)


class Conditions(NamedTuple):
    """What the world does: per hop lost and delayed, sensors misplaced (per axis) [m]."""

    p_loss: float = 0.3
    p_delay: float = 0.3
    misplaced_m: float = 0.0


USUAL = Conditions()
"""Of Fig. 10."""


class Outcome(NamedTuple):
    """A tracked run: what the network did, how many reports were of no target, the score."""

    passed: Passed
    false: int
    live: ManyScore
    lagged: ManyScore | None
    tracks: Tracks
    heard: Reports
    truth: Truth


def scenario(fusion: Fusion, conditions: Conditions, *, steps: int = 100) -> Scenario:
    """Set Fig. 10 up; reports of it do not depend on the network."""
    return Scenario(
        name="lochness",
        duration_s=float(steps),
        region=(0.0, 0.0, 100.0, 100.0),
        fusion=fusion,
        sensors=Sensors(spacing_m=1.0, misplaced_m=conditions.misplaced_m),
        signal=SignalModel(sigma_gain=0.0, placement_sigma_m=conditions.misplaced_m),
        targets=(
            Party(
                count=20,
                at_start=3,
                enter_s=(0.0, 60.0),
                lifetime_s=(30.0, 70.0),
                least_s=20.0,
                inset_m=10.0,
                speed_m_s=(0.5, 1.5),
                accel_sigma_m_s2=0.15,
            ),
        ),
        groups=tuple(Group(f"group {i + 1}", *place) for i, place in enumerate(LEADERS)),
        network=Channel(hop_m=11.5, p_loss=conditions.p_loss, p_delay=conditions.p_delay),
    )


class Field(NamedTuple):
    """A world before the network: what is reported where, to be sent over any network."""

    fusion: Fusion
    seed: int
    steps: int
    reports: Reports


def field(fusion: Fusion, seed: int, *, misplaced_m: float = 0.0, steps: int = 100) -> Field:
    """Fuse the signals of a world with a perfect network."""
    perfect = replace(
        scenario(fusion, Conditions(misplaced_m=misplaced_m), steps=steps), network=None
    )
    reports, _ = all_of(hear_reports(make_world(perfect, seed=seed)))
    return Field(fusion, seed, steps, reports)


def run(tracker: Tracker, made: Field, conditions: Conditions, *, lag_steps: int = 0) -> Outcome:
    """Send a field's reports over the network and track what arrives, online and with a lag."""
    world = _world(conditions, made.steps, made.seed)
    heard, passed = carry_reports(world, made.reports, stream(made.seed, "network"))
    site = told(world, tracker)
    tracks = track(site, tracker, heard)
    lagged = track(site, tracker, heard, lag_steps=lag_steps) if lag_steps else None
    return Outcome(
        passed,
        false_reports(world, heard),
        score_many(world.truth, tracks),
        None if lagged is None else score_many(world.truth, lagged),
        tracks,
        heard,
        world.truth,
    )


@functools.lru_cache(maxsize=32)
def _world(conditions: Conditions, steps: int, seed: int) -> World:
    """Lay a world's network out once for all trackers; how signals are fused does not matter."""
    return make_world(scenario("fit", conditions, steps=steps), seed=seed)


def told(world: World, tracker: Tracker) -> Site:
    """Tell a tracker what its reports are like: fits bring their covariance, centroids do not."""
    site = site_of(world)
    if tracker.fusion == "fit":
        own = replace(site.reports, p_detection=0.98, false_per_scan=0.1)
    else:
        # The mixture learns what it is not told; the paper's tracker has to be told.
        sigma = CENTROID_SIGMA_M if tracker.method == "paper" else None
        false = 6.0 if tracker.method == "paper" else None
        own = replace(site.reports, p_detection=_CENTROID_P, sigma_m=sigma, false_per_scan=false)
    return replace(site, reports=own)


def track(site: Site, tracker: Tracker, heard: Reports, *, lag_steps: int = 0) -> Tracks:
    """Track reports as they arrive."""
    whole = scene(site)
    if tracker.method == "paper":
        whole = _without_ages(whole)
    associator: AnyAssociator = (
        tracked_field(whole, np.array(LEADERS), tracker=lambda part: _alone(tracker, part))
        if tracker.grouped
        else _alone(tracker, whole)
    )
    pipeline = UntaggedTracker(site, Feed(associator=associator), lag_steps=lag_steps)
    return join_rows([pipeline.process(heard), pipeline.finish()])


def false_reports(world: World, reports: Reports, *, within_m: float = 3.0) -> int:
    """Count reports with no target within reach at their time."""
    truth, false = world.truth, 0
    for t_s in np.unique(reports.t_s):
        there: Matrix = truth.position[truth.t_s == t_s, :2]
        said: Matrix = reports.position[reports.t_s == t_s, :2]
        if not len(there):
            false += len(said)
            continue
        gaps = np.linalg.norm(said[:, None] - there, axis=-1).min(axis=1)
        false += int((gaps > within_m).sum())
    return false


def _alone(tracker: Tracker, part: Scene) -> AnyAssociator:
    match tracker.method:
        case "bernoulli":
            return Bernoulli(part)
        case "mcmcda":
            return Mcmcda(part, Sampling(moves=tracker.moves))
        case "paper":
            return Mcmcda(part, replace(Sampling.paper(), moves=tracker.moves))


def _without_ages(whole: Scene) -> Scene:
    """Tell one detection probability, as the paper does: that of reports that ever arrive."""
    ages: Sequence[float | Raster] = whole.reporting.p_detection or (0.5,)
    last = ages[-1]
    p = last.mean() if isinstance(last, Raster) else last
    return replace(whole, reporting=replace(whole.reporting, p_detection=(p,)))
