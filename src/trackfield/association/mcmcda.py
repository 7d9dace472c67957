"""MCMCDA, the tracker of Oh: the likeliest partition of a sliding window, by a Markov chain.

Beyond the paper: informed proposals, deaths summed over the slots in which they may have happened,
targets that leave the region, and the probability that a silent target is still there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from trackfield.association import hindsight, mcmcda_state, sampling, sliding, window_learning
from trackfield.association.contract import Estimates, Explanation, Info, ReportScan
from trackfield.association.identity import identities, renamed
from trackfield.association.mcmcda_state import State
from trackfield.association.model import Scene
from trackfield.association.partition import Window
from trackfield.association.sampling import MOVES, Sampling
from trackfield.association.window import window
from trackfield.association.window_learning import Learned
from trackfield.errors import InputError
from trackfield.types import Indices


@dataclass(frozen=True, slots=True)
class Mcmcda:
    """Tracker of a scene by MCMCDA; an `Associator`.

    The same scans, settings and seed give the same tracks. `ConfigurationError` for settings that
    cannot be.
    """

    scene: Scene
    sampling: Sampling = field(default_factory=Sampling)

    def __post_init__(self) -> None:
        sampling.check(self.sampling)

    def initial(self) -> State:
        """Make the state before the first scan."""
        random = np.random.SeedSequence(self.sampling.seed).generate_state(4, np.uint64)
        none = np.zeros(0, np.int32)
        return State(
            scans=(),
            owner=none,
            track=none,
            samples=np.zeros((self.sampling.samples, 0), np.int16),
            names=none,
            first_s=(),
            next_track=1,
            random=tuple(int(word) for word in random),
            learned=window_learning.initial(self.scene),
            begins=True,
        )

    def step(
        self, state: State, scan: ReportScan, late: Sequence[ReportScan] = ()
    ) -> tuple[State, Info]:
        """Slide the window to `scan`, put `late` reports into their slots, and sample partitions.

        `InputError` for a scan that is not newer than the last one, or numbers that are not finite.
        """
        taken = sliding.slide(self.scene, self.sampling.window, state, scan=scan, late=late)
        view = self._window(taken.scans, begins=taken.begins, learned=state.learned)
        chain = sampling.start(view, self.sampling, owner=taken.owner, random=list(state.random))
        moves = _affordable(self.sampling, chain.links())
        every = moves // self.sampling.samples
        chain.advance(moves - every * self.sampling.samples)
        samples = chain.trace(self.sampling.samples, every)
        owner = np.array(chain.best(), np.int32)
        names, next_track = identities(owner, taken.track, next_track=state.next_track)
        table = hindsight.table(view, owner)
        learned = window_learning.learn(state.learned, self.scene, view, owner=owner, tracks=table)
        after = State(
            scans=taken.scans,
            owner=owner,
            track=renamed(owner, taken.track, names),
            samples=samples,
            names=names,
            first_s=_first_s(state, view, owner=owner, names=names),
            next_track=next_track,
            random=tuple(chain.random()),
            learned=learned,
            begins=taken.begins,
        )
        proposed, accepted = chain.counts()
        counts = {
            **taken.counts,
            "reports": len(view),
            "links": chain.links(),
            "tracks": names.size,
        }
        for name, tried, done in zip(MOVES, proposed, accepted, strict=True):
            counts[f"{name}_proposed"], counts[f"{name}_accepted"] = tried, done
        open_now = window_learning.left_open(self.scene, learned)
        return after, Info(counts, {**open_now, "log_ratio": chain.scores()[1]}, moves)

    def estimates(self, state: State, lag_steps: int = 0) -> Estimates:
        """Tell where targets are in the newest scan, or were `lag_steps` before.

        `InputError` if the window does not reach there.
        """
        if not state.scans:
            raise InputError("no scan yet: expected a step before estimates")
        view = self._window(state.scans, begins=state.begins, learned=state.learned)
        return hindsight.estimates(view, state, self.sampling, lag_steps=lag_steps)

    def explain(self, state: State, track: int) -> Explanation | None:
        """Say by which reports a track is there, over the sampled partitions, likeliest first."""
        if not state.scans:
            return None
        view = self._window(state.scans, begins=state.begins, learned=state.learned)
        return hindsight.explain(view, state, self.sampling, track=track)

    def encode(self, state: State) -> bytes:
        """Write a state as bytes."""
        return mcmcda_state.encode(state)

    def decode(self, data: bytes) -> State:
        """Read a state that `encode` wrote; `StateError` for other bytes."""
        return mcmcda_state.decode(data)

    def _window(self, scans: Sequence[ReportScan], *, begins: bool, learned: Learned) -> Window:
        known = learned.known(self.scene)
        paper = not self.sampling.existence
        return window(self.scene, scans, known=known, begins=begins, paper=paper)


def _affordable(settings: Sampling, links: int) -> int:
    """Count the moves of a step: fewer in a crowd, the same for the same reports."""
    share = min(1.0, settings.full_links / max(links, 1))
    return int(np.ceil(settings.moves * share))


def _first_s(state: State, view: Window, *, owner: Indices, names: Indices) -> tuple[float, ...]:
    """When each track was first seen: now in the window, or before it."""
    before = dict(zip(state.names.tolist(), state.first_s, strict=True))
    first = np.full(names.size, np.inf)
    mine = owner >= 0
    np.minimum.at(first, owner[mine], view.t_s[view.slot[mine]])
    return tuple(
        min(float(t), before.get(int(name), np.inf)) for t, name in zip(first, names, strict=True)
    )
