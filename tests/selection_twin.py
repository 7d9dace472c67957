"""Selection of sensors in plain Python: every set in turn, and exchanges one by one."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from trackfield.types import Matrix

Set = tuple[int, ...]


def merit(information: Matrix, criterion: str) -> float:
    """The larger the better: -tr M^-1, log det M, the smallest eigenvalue; -inf if singular."""
    roots = np.linalg.eigvalsh(information)
    if criterion == "E":
        return float(roots[0])
    if roots[0] <= 0.0:
        return -np.inf
    return float(-(1.0 / roots).sum() if criterion == "A" else np.log(roots).sum())


def value(gains: Matrix, chosen: Set, prior: Matrix, criterion: str) -> float:
    rows = gains[list(chosen)]
    return merit(prior + rows.T @ rows, criterion)


def best(gains: Matrix, k: int, prior: Matrix, criterion: str) -> Set:
    sets = list(combinations(range(len(gains)), k))
    rows = gains[np.array(sets)]
    roots = np.maximum(np.linalg.eigvalsh(prior + np.swapaxes(rows, 1, 2) @ rows), 1e-300)
    if criterion == "E":
        return sets[int(np.argmax(roots[:, 0]))]
    values = -(1.0 / roots).sum(axis=1) if criterion == "A" else np.log(roots).sum(axis=1)
    return sets[int(np.argmax(values))]


def exchanged(gains: Matrix, k: int, prior: Matrix, criterion: str) -> Set:
    """Take the best next one k times; then replace the first, the second, ... while it helps."""
    n, d = gains.shape
    largest = float((gains**2).sum(axis=1).max())
    coarse, fine = (prior + ridge * largest * np.eye(d) for ridge in (1e-5, 1e-13))
    chosen: list[int] = []
    for _ in range(k):
        rest = [i for i in range(n) if i not in chosen]
        chosen.append(max(rest, key=lambda i: value(gains, (*chosen, i), coarse, criterion)))
    idle, place = 0, 0
    while idle < k:
        now = value(gains, tuple(chosen), fine, criterion)
        kept = chosen[:place] + chosen[place + 1 :]
        rest = [i for i in range(n) if i not in chosen]
        other = max(rest, key=lambda i: value(gains, (*kept, i), fine, criterion), default=None)
        idle += 1
        if other is not None:
            gain = value(gains, (*kept, other), fine, criterion) - now
            if gain > 1e-12 * abs(now):
                chosen[place], idle = other, 0
        place = (place + 1) % k
    return tuple(sorted(chosen))
