"""What the tracker of angles knows of one target: an immutable value."""

from __future__ import annotations

from typing import NamedTuple

from trackfield.filtering.interacting import Modes
from trackfield.filtering.scans import Scan
from trackfield.types import Gaussian, Matrix, Vector


class AngleTrack(NamedTuple):
    """A track after its last scan: hypotheses (H), each with the modes (M) of a bank.

    `names` (H,) stay with a hypothesis for life, `weights` (H,) sum to 1. `whole` and `prior`
    (H, n) are the beliefs after and before that scan, modes taken together. `nis` is the squared
    innovation per reading of the likeliest hypothesis, `misfits` says of the last scans whether it
    was large, `evidence` (H, k) how likely they were to each [log]. `confirmed`: there is one
    answer, and it is known to a part of the field.
    """

    t_s: float
    names: tuple[int, ...]
    weights: Vector
    modes: Modes
    prior: Gaussian
    whole: Gaussian
    nis: float
    misfits: tuple[bool, ...]
    evidence: Matrix
    confirmed: bool


class AngleState(NamedTuple):
    """State of the tracker: the last scans, for a start, and the track, None before one started.

    `waited` counts scans since the last try to start, `number` the tracks so far. `alive` is the
    chance that each sensor works, as far as its readings and its silence tell: 0 of one that was
    never heard; empty where silence does not count.
    """

    recent: tuple[Scan, ...] = ()
    waited: int = 0
    number: int = 0
    track: AngleTrack | None = None
    alive: tuple[float, ...] = ()
