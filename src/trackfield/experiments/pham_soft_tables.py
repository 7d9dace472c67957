"""What the soft bound's experiment found, as it is told."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from trackfield.experiments import results
from trackfield.experiments.pham_soft_paths import SIGMA_M, SPEED_M_S
from trackfield.experiments.pham_soft_runs import BATTERY, REACH_M
from trackfield.types import Vector

if TYPE_CHECKING:
    from trackfield.experiments.pham_soft import Point, Soft


def tables(found: Soft) -> tuple[results.Table, ...]:
    """Bars at B = 3, lives, all settings, and targets that turn."""
    return (_bars(found), _lives(found), _grid(found), _turning(found))


def findings(found: Soft) -> tuple[str, ...]:
    """Say what the runs say, in sentences."""
    rows = [found.judged[kind] for kind in found.judged]
    worst = max(rows, key=lambda row: row.failed)
    ratio = [found.judged[kind].rmse / found.hard[kind].rmse for kind in found.judged]
    told = [
        "Pham has no such bound: nothing of the paper stands beside these numbers. The passes are "
        f"ours (intervals of {SPEED_M_S:g}, sigma {SIGMA_M:g}, reach {REACH_M:g}, "
        f"{BATTERY} readings a battery), since the paper gives one trajectory and no batteries.",
        f"A bound on what the filter will know (B = 3, q/s = .6) asks "
        f"{min(row.asked for row in rows):.2f} to {max(row.asked for row in rows):.2f} sensors an "
        f"interval where a snapshot takes three, for {min(ratio):.2f} to {max(ratio):.2f} times "
        f"the error; at most {100 * worst.failed:.1f} % of the intervals fail.",
        "Targets that turn are lost to a filter that does not allow for it, and the filter does "
        "not know: NEES "
        + ", ".join(f"{p.soft.nees:.2f} at q/s {p.agility:g}" for p in found.turning)
        + " (2 is honest). The model must be told; then the service is kept at a higher price.",
    ]
    alive = [kind for kind, lives in found.lives.items() if min(map(np.min, lives)) > 0]
    for kind in alive:
        lives = found.lives[kind]
        told.append(
            f"First empty node, {kind}: {_ratio(lives.soft, lives.geometry)} times geometry alone "
            f"with the same filter (mean of the fields' own ratios "
            f"{(lives.soft / lives.geometry).mean():.2f}), {_ratio(lives.soft, lives.hard)} times "
            "the hard bound with the same weights."
        )
    return tuple(told)


def _bars(found: Soft) -> results.Table:
    rows: list[tuple[str, ...]] = []
    for kind, ours in found.judged.items():
        hard = found.hard[kind]
        rows.append(
            (
                kind,
                f"{100 * ours.failed:.1f} %",
                f"{ours.asked:.2f}",
                f"{ours.asked / 3.0:.2f}",
                f"{ours.rmse:.2f}",
                f"{ours.rmse / hard.rmse:.2f}",
                f"{ours.nees:.2f}",
                f"{ours.lost:.1f} ({ours.lost_passes:.1f})",
            )
        )
    columns = (
        "paths",
        "failed",
        "sensors",
        "over three",
        "RMSE [sigma]",
        "over hard",
        "NEES",
        "lost in 5000 (passes in 200)",
    )
    passes = found.size.judged
    title = f"Soft bound, B 3, q/s .6: {found.size.fields} fields, {passes} passes"
    return results.Table(title, columns, tuple(rows))


def _lives(found: Soft) -> results.Table:
    rows = tuple(
        (
            kind,
            *(_life(values) for values in lives),
            _ratio(lives.soft, lives.geometry),
            _ratio(lives.soft, lives.hard),
        )
        for kind, lives in found.lives.items()
    )
    columns = ("paths", "soft", "hard", "geometry alone", "soft/geometry", "soft/hard")
    return results.Table("First empty node [intervals], mean (least to most)", columns, rows)


def _grid(found: Soft) -> results.Table:
    rows = tuple(
        (f"{p.bound:g}", f"{p.agility:g}", *_cells(p), f"{p.soft.rmse / p.hard.rmse:.2f}")
        for p in found.grid
    )
    columns = ("B", "q/s", "failed", "sensors", "RMSE", "NEES", "inside 95 %", "RMSE over hard")
    return results.Table(
        "Soft bound by B and q/s: wandering targets, full batteries", columns, rows
    )


def _turning(found: Soft) -> results.Table:
    rows = tuple(
        (f"{p.agility:g}", *_cells(p), f"{p.hard.rmse:.2f}", f"{p.hard.nees:.2f}")
        for p in found.turning
    )
    columns = ("q/s", "failed", "sensors", "RMSE", "NEES", "inside 95 %", "hard RMSE", "hard NEES")
    return results.Table("Targets that turn, B 3, by what the filter allows for", columns, rows)


def _cells(point: Point) -> tuple[str, ...]:
    s = point.soft
    return (
        f"{100 * s.failed:.1f} %",
        f"{s.asked:.2f}",
        f"{s.rmse:.2f}",
        f"{s.nees:.2f}",
        f"{100 * s.inside:.1f} %",
    )


def _life(values: Vector) -> str:
    if values.min() == 0:
        return "not yet"
    return f"{values.mean():.0f} ({values.min():.0f} to {values.max():.0f})"


def _ratio(ours: Vector, theirs: Vector) -> str:
    if ours.min() == 0 or theirs.min() == 0:
        return "-"
    return f"{ours.mean() / theirs.mean():.2f}"
