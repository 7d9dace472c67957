"""Rows of text from columns, all rows at once: each cell a few bytes of a matrix, 0 a hole.

A matrix of cells has a row a row, and as many columns of bytes as the longest cell; what is no
byte of the text is 0 and drops out when rows are packed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from trackfield.types import Vector

Cells = NDArray[np.uint8]  # (n, width)

_EXACT = 2**53
_ZERO, _MINUS, _POINT = (ord(character) for character in "0-.")


def _groups() -> NDArray[np.uint32]:
    """Make a hole and three digits of 0 to 999; first without zeros in front, then with them."""
    number = np.arange(1000)[:, None]
    digits = (number // [1000, 100, 10, 1] % 10 + _ZERO) * [0, 1, 1, 1]
    short = np.where(number < [0, 100, 10, 0], 0, digits)
    return np.concatenate([short, digits]).astype(np.uint8).view(np.uint32)[:, 0]


_GROUPS = _groups()


def fixed_cells(values: Vector, decimals: int, *, blank: bytes = b"") -> Cells:
    """Write numbers rounded to 3, 6 or 9 decimals, NaN as `blank`."""
    missing = np.isnan(values)
    if missing.all():
        return np.broadcast_to(np.frombuffer(blank, np.uint8), (values.size, len(blank)))
    scaled = np.rint(np.abs(np.where(missing, 0.0, values)) * 10.0**decimals)
    if scaled.max() > _EXACT:
        texts = [b"%.*f" % (decimals, round(v, decimals) + 0.0) for v in values.tolist()]
        return text_cells([blank if gap else t for t, gap in zip(texts, missing, strict=True)])
    whole = np.floor_divide(scaled, 10.0**decimals)
    part = scaled - whole * 10.0**decimals
    minus = np.where((scaled > 0) & (values < 0), _MINUS, 0).astype(np.uint8)[:, None]
    point = np.full(minus.shape, _POINT, np.uint8)
    cells = np.concatenate([minus, _whole(whole), point, _part(part, decimals)], axis=1)
    if missing.any():
        hole = np.zeros(max(cells.shape[1], len(blank)), np.uint8)
        hole[: len(blank)] = np.frombuffer(blank, np.uint8)
        cells = np.pad(cells, ((0, 0), (0, hole.size - cells.shape[1])))
        cells[missing] = hole
    return cells


def text_cells(texts: Sequence[bytes]) -> Cells:
    """Take bytes as they stand; none of them is 0."""
    array = np.array(texts, np.bytes_)
    return array.view(np.uint8).reshape(len(texts), array.itemsize)


def packed(pieces: Sequence[Cells | bytes], rows: int) -> bytes:
    """Join all rows: of each, its cells and the constant bytes between them."""
    widths = [len(piece) if isinstance(piece, bytes) else piece.shape[1] for piece in pieces]
    edges = np.cumsum([0, *widths])
    matrix = np.empty((rows, edges[-1]), np.uint8)
    for piece, start, end in zip(pieces, edges, edges[1:], strict=False):
        constant = isinstance(piece, bytes)
        matrix[:, start:end] = np.frombuffer(piece, np.uint8) if constant else piece
    return matrix[matrix != 0].tobytes()


def _whole(number: Vector) -> Cells:
    """Digits of whole numbers, without zeros in front."""
    groups: list[NDArray[np.uint32]] = []
    while not groups or number.any():
        higher = np.floor(number / 1000)
        group = (number - higher * 1000).astype(np.int32)
        group[higher > 0] += 1000
        digits = _GROUPS[group]
        if groups:  # nothing above and nothing in it: a hole; but the last group says at least 0
            digits[number == 0] = 0
        groups.insert(0, digits)
        number = higher
    return _bytes(groups)


def _part(number: Vector, decimals: int) -> Cells:
    """Digits of a fraction, with zeros in front; 3, 6 or 9 of them."""
    left = number.astype(np.int32)
    groups: list[NDArray[np.uint32]] = []
    for _ in range(0, decimals, 3):
        higher = left // 1000
        groups.insert(0, _GROUPS[left - higher * 1000 + 1000])
        left = higher
    return _bytes(groups)


def _bytes(groups: list[NDArray[np.uint32]]) -> Cells:
    return np.column_stack(groups).view(np.uint8)
