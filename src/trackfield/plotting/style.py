"""What all figures share: colours, frames, broken lines, and how they become files.

Colours are those of Okabe and Ito, which colour-blind readers can tell apart; shape and line style
say the same again.
"""

# Matplotlib's own types leave keyword arguments unknown.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from trackfield.errors import InputError
from trackfield.types import Matrix, Vector

PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442")
GREY = "#8C8C8C"
SIGMAS_95 = 2.447746830680816  # half an axis of the 95 % ellipse in standard deviations
NAMED = 40  # sensors that are named, at most
GAP_S = 3.0  # a line is broken where nothing was known for longer


def new_figure(width: float, height: float) -> Figure:
    """Make an empty figure of so many inches, which needs no screen."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def frame_map(axes: Axes, title: str) -> None:
    """Make axes a map: metres east and north, to scale."""
    axes.set(xlabel="x, east [m]", ylabel="y, north [m]", aspect="equal")
    axes.set_title(title)
    axes.grid(color="0.92")
    axes.set_axisbelow(True)


def kind_of(path: Path) -> str:
    """Kind of picture that the suffix of `path` says; `InputError` if there is none such."""
    kinds = FigureCanvasAgg.get_supported_filetypes()
    kind = path.suffix.removeprefix(".").lower()
    if kind not in kinds:
        expected = ", ".join(f".{kind}" for kind in sorted(kinds))
        raise InputError(f"{path}: found suffix {path.suffix!r}, expected one of {expected}")
    return kind


def save(figure: Figure, path: str | Path) -> None:
    """Write a figure, whole or not at all; the kind of file follows from its suffix."""
    path = Path(path)
    kind = kind_of(path)
    part = path.with_name(f".{path.name}.part")
    try:
        figure.savefig(part, dpi=150, format=kind)
        part.replace(path)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None


def broken(t_s: Vector, values: Matrix, *, gap_s: float = GAP_S) -> Matrix:
    """Put a row of NaN into `values` (n, d) wherever more than `gap_s` passed: a broken line."""
    gaps = np.flatnonzero(np.diff(t_s) > gap_s) + 1
    return np.insert(values, gaps, np.nan, axis=0)
