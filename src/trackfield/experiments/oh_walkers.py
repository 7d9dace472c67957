"""Oh, Figs. 17-18: one, two and three walkers in the outdoor field of binary sensors.

12 x 12 nodes at 5 m, R 7.62 m, p .7, q .05, six nodes dead, one message of ten lost; the walkers
cross the field, each from another side. The recordings of the demonstration are not to be had: the
field is simulated, many times over.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from trackfield.association.bernoulli import Bernoulli
from trackfield.association.mcmcda import Mcmcda
from trackfield.association.sampling import Sampling
from trackfield.experiments.results import Interval, Table, mean_interval
from trackfield.localization.detection_cells import (
    DetectionCells,
    cluster_reports,
    detection_cells,
    detection_likelihoods,
)
from trackfield.localization.peeling import peel
from trackfield.metrics.error import shown
from trackfield.metrics.many import followed
from trackfield.network.channel import Channel
from trackfield.network.site import Site
from trackfield.pipeline.scene import scene
from trackfield.pipeline.untagged import Feed, UntaggedTracker
from trackfield.sensing.detection import DetectionModel
from trackfield.simulation.hearing import all_of, hear_readings
from trackfield.simulation.scenario import Party, Scenario, Sensors
from trackfield.simulation.told_site import site_of
from trackfield.simulation.world import World, make_world
from trackfield.types import Readings, Reports, Tracks, Truth, join_rows

MODEL = DetectionModel(radius_m=7.62, p_detection=0.7, p_false=0.05)
STEPS = 75
NEAR_M = 6.0
_SETTLED_S = 5.0
_REPORT_SIGMA_M = 2.0  # per axis, of the paper's clusters
Way = Literal["clusters and MCMCDA", "peeling and Bernoulli mixture", "track-before-detect"]
WAYS: tuple[Way, ...] = (
    "clusters and MCMCDA",
    "peeling and Bernoulli mixture",
    "track-before-detect",
)


class Demonstration(NamedTuple):
    """One run: the world, what arrived, and what each way showed."""

    world: World
    readings: Readings
    tracks: Mapping[Way, Tracks]


class Walkers(NamedTuple):
    """Share of runs that went right, by number of walkers and way; and a run to draw."""

    right: Mapping[int, Mapping[Way, Interval]]
    picture: Demonstration


def scenario(walkers: int, rng: np.random.Generator) -> Scenario:
    """Set the field up; each walker comes over another edge and leaves over the one across."""
    edges = rng.permutation(4)
    parties = [_walker(int(edges[i % 4]), rng) for i in range(walkers)]
    return Scenario(
        name="walkers",
        duration_s=float(STEPS),
        region=(0.0, 0.0, 60.0, 60.0),
        sensors=Sensors(spacing_m=5.0, dead=6),
        detection=MODEL,
        targets=tuple(parties),
        network=Channel(p_loss=0.1, multipath=False),
    )


def _walker(edge: int, rng: np.random.Generator) -> Party:
    """Draw a walker from one edge of the outermost sensors to the one across."""
    low, high = 2.5, 57.5
    here, there = (low + (high - low) * rng.uniform(0.2, 0.8, 2)).tolist()
    ways = {
        0: ((here, low), (there, high)),
        1: ((high, here), (low, there)),
        2: ((here, high), (there, low)),
        3: ((low, here), (high, there)),
    }
    begin = float(np.floor(rng.uniform(0.0, 15.0)))
    speed = float(rng.uniform(1.1, 1.3))
    length = float(np.hypot(*np.subtract(*ways[edge])))
    return Party(
        motion="walk",
        count=1,
        path=ways[edge],
        enter_s=(begin, begin),
        lifetime_s=(length / speed, length / speed),
        speed_m_s=(speed, speed),
    )


def run(seed: int, walkers: int) -> Demonstration:
    """Simulate one run and track it each way."""
    world = make_world(scenario(walkers, np.random.default_rng(seed)), seed=seed)
    readings, _ = all_of(hear_readings(world))
    site = site_of(world)
    cells = detection_cells(MODEL, site.positions[:, :2], region=world.scenario.area, cell_m=1.0)
    tracks: dict[Way, Tracks] = {way: _track(way, site, cells, readings, seed=seed) for way in WAYS}
    return Demonstration(world, readings, tracks)


def walkers(
    rng: np.random.Generator, *, runs: int, first_seed: int, tick: Callable[[], None]
) -> Walkers:
    """Judge `runs` runs each of one, two and three walkers; `tick` is called after each run."""
    right: dict[int, dict[Way, Interval]] = {}
    picture: Demonstration | None = None
    for count in (1, 2, 3):
        found: dict[Way, list[bool]] = {way: [] for way in WAYS}
        for i in range(runs):
            picture = run(first_seed + 1000 * count + i, count)
            for way in WAYS:
                found[way].append(is_right(picture.world.truth, picture.tracks[way]))
            tick()
        right[count] = {way: mean_interval(np.array(found[way], float), rng) for way in WAYS}
    return Walkers(right, run(first_seed, 3) if picture is None else picture)


def is_right(truth: Truth, tracks: Tracks) -> bool:
    """Judge a run: as many identities as walkers, and each walker's own from soon after to the end.

    Identities count that are shown for five steps or more. Each walker is near (6 m) its own track
    in 80 % of its steps from 5 s after it entered, and in its last three; none changes its track.
    """
    visible = shown(tracks)
    lives = np.bincount(tracks.track[visible])
    if int((lives >= 5).sum()) != len(truth.target_ids):
        return False
    whose = followed(truth, tracks, match_m=NEAR_M)
    for walker in range(len(truth.target_ids)):
        mine = np.unique(tracks.track[whose == walker])
        if mine.size != 1:
            return False
        times = np.sort(truth.t_s[truth.target == walker])
        near = np.isin(times, tracks.t_s[whose == walker])
        settled = times >= times[0] + _SETTLED_S
        if near[settled].mean() < 0.8 or not near[-3:].all():
            return False
    return True


def table(found: Walkers, runs: int) -> Table:
    """Show which share of the runs went right [%]."""
    rows = tuple(
        (way, *(_percent(found.right[count][way]) for count in found.right)) for way in WAYS
    )
    columns = ("way", "1 walker", "2 walkers", "3 walkers")
    return Table(f"Figs. 17-18: runs that went right [%], {runs} runs each", columns, rows)


def _percent(share: Interval) -> str:
    return Interval(*(100.0 * value for value in share)).text(0)


def _track(way: Way, site: Site, cells: DetectionCells, readings: Readings, *, seed: int) -> Tracks:
    if way == "track-before-detect":
        pipeline = UntaggedTracker(site, Feed(source="detection", seed=seed))
        return join_rows([pipeline.process(readings), pipeline.finish()])
    reports = _reports(way, cells, readings, np.random.default_rng(seed))
    own = replace(site.reports, p_detection=0.9, sigma_m=_REPORT_SIGMA_M, false_per_scan=1.0)
    told = replace(site, reports=own, network=None)
    whole = scene(told)
    associator = (
        Mcmcda(whole, Sampling.paper(seed=seed))
        if way == "clusters and MCMCDA"
        else Bernoulli(whole)
    )
    pipeline = UntaggedTracker(told, Feed(associator=associator))
    # Silence counts: the run goes on to its end without a report.
    parts = [pipeline.process(reports)] if len(reports) else []
    return join_rows([*parts, pipeline.finish()])


def _reports(
    way: Way, cells: DetectionCells, readings: Readings, rng: np.random.Generator
) -> Reports:
    """Make position reports of each step's detections."""
    times, places, spreads = list[float](), list[np.ndarray](), list[np.ndarray]()
    for t_s in np.unique(readings.t_s):
        detected = np.zeros(cells.models.radius_m.size, bool)
        detected[readings.sensor[(readings.t_s == t_s) & (readings.value > 0)]] = True
        if way == "clusters and MCMCDA":
            likelihoods = detection_likelihoods(cells, detected, least=3)
            position = cluster_reports(cells, likelihoods, rng, radius_m=MODEL.radius_m)
            covariance = np.full((len(position), 3), np.nan)
        else:
            found = peel(cells, detected, delivery=0.9)
            position, covariance = found.position, found.covariance
        times += [float(t_s)] * len(position)
        places.append(position)
        spreads.append(covariance)
    n = len(times)
    nothing = np.full(n, np.nan)
    position = np.concatenate([np.zeros((0, 2)), *places])
    return Reports(
        t_s=np.array(times),
        arrival_s=nothing,
        position=np.column_stack([position, nothing]),
        covariance=np.concatenate([np.zeros((0, 3)), *spreads]),
        confidence=nothing,
    )
