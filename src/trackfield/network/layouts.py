"""Where to set nodes up: lattices of the plane and of space, at random, on a surface.

A lattice is a stack of square layers, in the plane of rows: which of them, `_STACKS` says.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from trackfield.errors import InputError
from trackfield.network.boxes import Box, box_of
from trackfield.raster import Region
from trackfield.types import Matrix, Vector

Lattice = Literal["square", "hexagonal", "cubic", "face-centred", "body-centred"]
Height = Callable[[Matrix], Vector]
"""Height (n,) [m] of a surface over places (n, 2) [m]."""

_MOST_NODES = 10_000_000
_ROUNDING = 1e-9  # of a pitch: a node that just fits, fits
_CANDIDATES = 64  # places drawn for each node of a surface


class _Stack(NamedTuple):
    """A lattice whose nearest nodes are 1 apart.

    Layers of `pitch` lie `rise` above one another; every other one is moved along each of its axes
    by a `shift` of a pitch. The cell of a node (what is nearest to it) reaches `tip` beyond its
    layer. Every place is within root `cover[k - 1]` of k nodes.
    """

    dimensions: int
    pitch: float
    rise: float
    shift: float
    tip: float
    cover: tuple[float, ...]


_STACKS: dict[Lattice, _Stack] = {
    "square": _Stack(2, 1.0, 1.0, 0.0, 0.5, (1 / 2, 1, 5 / 4, 25 / 18, 5 / 2, 5 / 2)),
    "hexagonal": _Stack(
        2, 1.0, math.sqrt(3) / 2, 0.5, math.sqrt(1 / 3), (1 / 3, 1, 1, 4 / 3, 7 / 4, 49 / 27)
    ),
    "cubic": _Stack(3, 1.0, 1.0, 0.0, 0.5, (3 / 4, 1, 5 / 4, 5 / 4, 3 / 2, 3 / 2)),
    "face-centred": _Stack(
        3, 1.0, math.sqrt(1 / 2), 0.5, math.sqrt(1 / 2), (1 / 2, 1, 1, 1, 11 / 8, 11 / 8)
    ),
    "body-centred": _Stack(
        3,
        math.sqrt(4 / 3),
        math.sqrt(1 / 3),
        0.5,
        math.sqrt(1 / 3),
        (5 / 12, 1, 1, 25 / 24, 13 / 12, 121 / 96),
    ),
}


def lattice(region: Region | Box, spacing_m: float, *, layout: Lattice = "square") -> Matrix:
    """Nodes (n, d) [m] of a lattice in the middle of a region; nearest ones `spacing_m` apart.

    As many as have a cell of their own in the region: row by row to the north, in space layer by
    layer upwards. There may be none.
    """
    box, stack = _fitting(region, layout)
    layers, columns = _shape(box, spacing_m, stack)
    if layers * math.prod(columns) > _MOST_NODES:
        raise InputError(f"found a spacing of {spacing_m:g} m, with more than {_MOST_NODES} nodes")
    count = np.array([*columns, layers])
    # The last axis outermost, the first one innermost: rows from west to east.
    grid = np.indices(tuple(count.tolist())[::-1]).reshape(box.dimensions, -1)[::-1].T
    steps = spacing_m * np.append(np.full(len(columns), stack.pitch), stack.rise)
    places = grid - (count - 1) / 2.0
    if layers > 1:
        places[:, :-1] += np.where(grid[:, -1:] % 2, 0.5, -0.5) * stack.shift
    return steps * places + (box.low + box.high) / 2.0


def lattice_count(region: Region | Box, spacing_m: float, *, layout: Lattice = "square") -> int:
    """How many nodes `lattice` sets up."""
    box, stack = _fitting(region, layout)
    layers, columns = _shape(box, spacing_m, stack)
    return layers * math.prod(columns)


def lattice_spacing(region: Region | Box, count: int, *, layout: Lattice = "square") -> float:
    """Widest spacing [m] at which `lattice` has at least `count` nodes, to 1e-9 of it."""
    box, stack = _fitting(region, layout)
    if not 0 < count <= _MOST_NODES:
        raise InputError(f"found a count of {count}, expected from 1 to {_MOST_NODES}")
    low, high = 0.0, float(box.size.max()) / stack.rise
    volume = stack.pitch ** (box.dimensions - 1) * stack.rise
    guess = (box.measure / count / volume) ** (1.0 / box.dimensions)
    while high - low > 1e-9 * high:
        layers, columns = _shape(box, guess, stack)
        low, high = (guess, high) if layers * math.prod(columns) >= count else (low, guess)
        guess = (low + high) / 2.0
    return low


def covering_spacing(reach_m: float, *, layout: Lattice = "hexagonal", times: int = 1) -> float:
    """Widest spacing [m] at which every place is within `reach_m` of `times` nodes, 1 to 6 of them.

    Of an endless lattice: r sqrt(3) for "hexagonal", the fewest nodes that can cover the plane;
    r sqrt(2) for "square"; r sqrt(2) for "face-centred", which packs balls best, but r sqrt(12/5)
    for "body-centred", which covers space with 30 % fewer nodes.
    """
    stack = _STACKS[layout]
    if not (reach_m > 0.0 and math.isfinite(reach_m)):
        raise InputError(f"found a reach of {reach_m:g} m, expected a finite one above 0")
    if not 1 <= times <= len(stack.cover):
        raise InputError(f"found times = {times}, expected from 1 to {len(stack.cover)}")
    return reach_m / math.sqrt(stack.cover[times - 1])


def covering(region: Region | Box, reach_m: float, *, layout: Lattice = "hexagonal") -> Matrix:
    """Nodes (n, d) [m] such that every place of a region is within `reach_m` of one of them.

    The widest lattice that covers, shrunk along the axes until it just fits: which only brings
    nodes nearer to every place. The nodes are those whose cells meet the region.
    """
    box, stack = _fitting(region, layout)
    spacing = covering_spacing(reach_m, layout=layout)
    pitch, rise = stack.pitch * spacing, stack.rise * spacing
    inset = rise - stack.tip * spacing  # how deep below its first layer the region is covered
    height = float(box.size[-1])
    layers = 1 + max(0, math.ceil((height - 2.0 * inset) / rise - _ROUNDING))
    heights = np.linspace(inset, height - inset, layers) if layers > 1 else [height / 2.0]
    if layers * math.prod(math.ceil(w / pitch) + 1 for w in box.size[:-1]) > _MOST_NODES:
        raise InputError(f"found a reach of {reach_m:g} m, with more than {_MOST_NODES} nodes")
    choices: list[Matrix] = []
    for first in (0, 1):
        shifted = [stack.shift > 0.0 and i % 2 == first for i in range(layers)]
        parts = [_layer(box, pitch, (z, s)) for z, s in zip(heights, shifted, strict=True)]
        choices.append(np.concatenate(parts))
    return min(choices, key=len) + box.low


def random_places(region: Region | Box, count: int, *, rng: np.random.Generator) -> Matrix:
    """Nodes (count, d) [m] anywhere in a region, independent and uniform."""
    box = box_of(region)
    if not 0 <= count <= _MOST_NODES:
        raise InputError(f"found a count of {count}, expected from 0 to {_MOST_NODES}")
    return rng.uniform(box.low, box.high, (count, box.dimensions))


def on_surface(places: Matrix, height: Height) -> Matrix:
    """Nodes (n, 3) [m] on the surface z = height(x, y) at places (n, 2) [m]."""
    if places.ndim != 2 or places.shape[1] != 2:
        raise InputError(f"places of shape {places.shape}, expected (n, 2)")
    z = np.asarray(height(places), np.float64)
    if z.shape != (len(places),) or not np.isfinite(z).all():
        raise InputError(f"heights of shape {z.shape}, expected {len(places)} finite numbers")
    return np.column_stack([places, z])


def random_on_surface(
    region: Region, count: int, *, height: Height, rng: np.random.Generator
) -> Matrix:
    """Nodes (count, 3) [m] on the surface z = height(x, y), as many a square metre of it anywhere.

    Drawn without repetition from 64 times as many places of the plane, each with the area of the
    surface above it, sqrt(1 + |slope|^2), as its weight.
    """
    places = random_places(region, _CANDIDATES * count, rng=rng)
    step = 1e-5 * math.sqrt(region.area)
    east, north = step * np.eye(2)
    rise_x = (height(places + east) - height(places - east)) / (2.0 * step)
    rise_y = (height(places + north) - height(places - north)) / (2.0 * step)
    area = np.sqrt(1.0 + rise_x**2 + rise_y**2)
    chosen = rng.choice(len(places), count, replace=False, p=area / area.sum())
    return on_surface(places[chosen], height)


def paraboloid(box: Box) -> Height:
    """Make a bowl that stands in the middle of a box's floor and meets the ceiling at its corners.

    Our reading of the field of Pham's chapter 3: 441 nodes on a parabolic surface in 10 x 10 x 6.
    """
    middle = (box.low[:2] + box.high[:2]) / 2.0
    farthest = float(((box.high[:2] - middle) ** 2).sum())

    def height(places: Matrix) -> Vector:
        return box.low[2] + box.size[2] * ((places - middle) ** 2).sum(axis=-1) / farthest

    return height


def _fitting(region: Region | Box, layout: Lattice) -> tuple[Box, _Stack]:
    box = box_of(region)
    if layout not in _STACKS:
        raise InputError(f"found layout {layout!r}, expected one of {', '.join(_STACKS)}")
    stack = _STACKS[layout]
    if stack.dimensions != box.dimensions:
        raise InputError(
            f"found a {layout} lattice, of {stack.dimensions} dimensions, "
            f"in a region of {box.dimensions}"
        )
    return box, stack


def _shape(box: Box, spacing_m: float, stack: _Stack) -> tuple[int, tuple[int, ...]]:
    """Layers, and columns of a layer along each of its axes."""
    if not (spacing_m > 0.0 and math.isfinite(spacing_m)):
        raise InputError(f"found a spacing of {spacing_m:g} m, expected a finite one above 0")
    sizes = box.size / max(spacing_m, 1e-12 * float(box.size.max()))
    layers = math.floor(sizes[-1] / stack.rise + _ROUNDING)
    shift = stack.shift if layers > 1 else 0.0
    columns = tuple(
        max(0, math.floor(size / stack.pitch - shift + _ROUNDING)) for size in sizes[:-1]
    )
    return layers, columns


def _layer(box: Box, pitch: float, layer: tuple[float, bool]) -> Matrix:
    """Nodes of a layer of a covering, at its height over the box's low corner.

    They stand in the middle of their cells; where the layer is shifted, half a pitch before. Each
    axis is cut in as many half pitches as it must.
    """
    height, shifted = layer
    axes: list[Vector] = []
    for size in box.size[:-1]:
        halves = max(1, math.ceil(2.0 * size / pitch - _ROUNDING))
        places = np.arange(0 if shifted else 1, halves + 1, 2) / halves
        axes.append(size * places)
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
    return np.column_stack([grid, np.full(len(grid), height)])
