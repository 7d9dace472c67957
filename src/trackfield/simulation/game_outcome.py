"""What a game came to: who was captured when, by whom, and whether everybody kept clear."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.simulation.game import Game, Turn
from trackfield.simulation.world import World
from trackfield.types import Tracks, Truth, Vector, join_rows

_MOST_TROUBLES = 100  # that are told


class Fate(NamedTuple):
    """What became of an evader, by times [s].

    It came at `from_s` and would have left at `to_s`. A pursuer first went for it at `chased_s` and
    then expected to be there at `expected_s`: as far as that can be told, it is whose track was
    nearest, within three capture radii. It was `captured_s` by `pursuer`, None if it was not.
    """

    target: str
    from_s: float
    to_s: float
    chased_s: float | None
    expected_s: float | None
    captured_s: float | None
    pursuer: int | None


class Outcome(NamedTuple):
    """A game as a whole.

    `paths` (steps, p, 2) [m] are those of pursuers at `t_s` (steps,); `tracks` are the rows that
    the coordinator was given. `apart_m` and `clear_m` are the least distances between two pursuers
    and of one to an obstacle, inf of none; steps in which two came nearer than `[pursuit]` allows
    them are `collisions`. `counts` are those of orders.
    """

    fates: tuple[Fate, ...]
    t_s: Vector
    paths: NDArray[np.float64]
    tracks: Tracks
    truth: Truth
    apart_m: float
    clear_m: float
    collisions: int
    counts: dict[str, int]
    troubles: tuple[str, ...]

    @property
    def captured(self) -> int:
        """How many evaders were captured."""
        return sum(fate.captured_s is not None for fate in self.fates)


def played(world: World, *, progress: Callable[[float], None] | None = None) -> Outcome:
    """Play the game of a world to its end; `progress` is called with shares from 0 to 1.

    `InputError` for a scenario without `[pursuit]`.
    """
    game, turns = Game(world), list[Turn]()
    for turn in game.turns():
        turns.append(turn)
        if progress is not None:
            progress(len(turns) / world.scenario.steps)
    rules = world.scenario.pursuit
    apart_m = 0.0 if rules is None or rules.vehicle != "thruster" else rules.apart_m
    clear_m = 0.0 if rules is None or rules.vehicle != "thruster" else rules.clear_m
    near = [turn.apart_m < apart_m or turn.clear_m < clear_m for turn in turns]
    within_m = 3.0 * (0.0 if rules is None else rules.capture_m)
    said = (line for turn in turns for line in turn.orders.trouble)
    return Outcome(
        fates=_fates(world, game, turns, within_m),
        t_s=np.array([turn.t_s for turn in turns]),
        paths=np.array([turn.pursuers[:, :2] for turn in turns]),
        tracks=join_rows([turn.tracks for turn in turns]),
        truth=game.truth,
        apart_m=min(turn.apart_m for turn in turns),
        clear_m=min(turn.clear_m for turn in turns),
        collisions=sum(near),
        counts=game.counts,
        troubles=tuple(dict.fromkeys(said))[:_MOST_TROUBLES],
    )


def _fates(world: World, game: Game, turns: list[Turn], within_m: float) -> tuple[Fate, ...]:
    chased: dict[int, tuple[float, float]] = {}
    captured: dict[int, tuple[float, int]] = {}
    for turn in turns:
        for one in turn.captured:
            captured[one.target] = turn.t_s, one.pursuer
        for i in np.flatnonzero(turn.orders.track >= 0):
            away = np.linalg.norm(turn.evaders.state[:, :2] - turn.orders.evader[i], axis=1)
            if away.size and away.min() <= within_m:
                target = int(turn.evaders.target[away.argmin()])
                expected = turn.t_s + float(turn.orders.expected_s[i])
                chased.setdefault(target, (turn.t_s, expected))
    return tuple(
        Fate(
            name,
            *life,
            *(chased.get(j) or (None, None)),
            *(captured.get(j) or (None, None)),
        )
        for j, (name, life) in enumerate(zip(world.truth.target_ids, game.lives(), strict=True))
    )
