"""Identities of a partition's tracks: each keeps the one that most of its reports had before."""

from __future__ import annotations

from collections import Counter

import numpy as np

from trackfield.types import Indices


def identities(owner: Indices, before: Indices, *, next_track: int) -> tuple[Indices, int]:
    """Name every track of `owner` (n,), (K,); and the next identity that is not used yet.

    `before` (n,) is the identity that each report had, 0 for none. The track and identity that
    share most reports find each other first; ties go to the older identity. Tracks that find none
    get new ones.
    """
    count = int(owner.max(initial=-1)) + 1
    told = (owner >= 0) & (before > 0)
    votes = Counter(zip(owner[told].tolist(), before[told].tolist(), strict=True))
    names = np.zeros(count, np.int32)
    used: set[int] = set()
    for (k, name), _ in sorted(votes.items(), key=lambda vote: (-vote[1], vote[0][1], vote[0][0])):
        if names[k] == 0 and name not in used:
            names[k] = name
            used.add(name)
    for k in np.flatnonzero(names == 0):
        names[k] = next_track
        next_track += 1
    return names, next_track


def renamed(owner: Indices, before: Indices, names: Indices) -> Indices:
    """Name every report by its track, (n,); one whose track dissolved keeps its name."""
    gone = ~np.isin(before, names)
    mine = np.append(names, 0)[owner]
    return np.where(owner >= 0, mine, np.where(gone, before, 0)).astype(np.int32)
