"""Cells of text to numbers and names, a whole column at once.

A cell is bytes `start` to `end` of a buffer. The buffer must go on for `PADDING` bytes after the
last cell, because columns are cut out at the width of their widest cell.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from trackfield.types import Vector

Bytes = NDArray[np.uint8]
Places = NDArray[np.intp]

PADDING = 64
_DIGITS = 18  # as many always fit into 64 bits
_TENS = 10.0 ** np.arange(_DIGITS + 1)  # exact, as all powers of ten up to 22 are
_EXACT = 2**53
_MASKS = np.array([(1 << (8 * kept)) - 1 for kept in range(9)], np.uint64)
# Odd, and otherwise arbitrary: one for each eight bytes of a name.
_MIXERS = np.array(
    [((0x9E3779B97F4A7C15 * (2 * i + 1)) | 1) % 2**64 for i in range(PADDING // 8)], np.uint64
)


class Distinct(NamedTuple):
    """Cells that differ: `first` row of each, in order of rows, and which of them a row has."""

    first: Places
    which: Places


def parse_numbers(buffer: Bytes, start: Places, end: Places) -> tuple[Vector, int | None]:
    """Correctly rounded values of cells, NaN for empty ones; and the first row with no number.

    Digits with at most one point and a minus are m / 10^k, exact operands if m <= 2^53, hence
    rounded once (Clinger, 1990). All other cells go through `float`, one by one.
    """
    filled = end > start
    if not filled.any():
        return np.full(start.size, np.nan), None
    values, plain = _plain(buffer, start, end)
    values[~plain] = np.nan
    rest = np.flatnonzero(~plain & filled)
    texts = _texts(buffer, start[rest], end[rest])
    try:
        values[rest] = list(map(float, texts))
    except ValueError:
        return _parse_each(values, rest, texts)
    return _parse_each(values, rest, texts) if b"_" in b"".join(texts) else (values, None)


def _parse_each(values: Vector, rows: Places, texts: list[bytes]) -> tuple[Vector, int | None]:
    """Parse texts one by one, up to the first that is no number; a blank is an empty cell."""
    for row, text in zip(rows.tolist(), texts, strict=True):
        try:
            values[row] = float(text) if text.strip() else np.nan
        except ValueError:
            return values, row
        if b"_" in text:  # Python reads 1_000, a person more likely meant something else
            return values, row
    return values, None


def distinct(buffer: Bytes, start: Places, end: Places) -> Distinct:
    """Find the different cells of a column."""
    length = end - start
    words = -(-int(length.max(initial=1)) // 8)
    if words > PADDING // 8:
        return _distinct_texts(buffer, start, end)
    bits = sliding_window_view(buffer, 8 * words)[start].view("<u8")
    bits &= _MASKS[np.clip(length[:, None] - 8 * np.arange(words), 0, 8)]
    key = bits[:, 0] if words == 1 else (bits * _MIXERS[:words]).sum(axis=1, dtype=np.uint64)
    if (key == key[0]).all():
        first, which = np.zeros(1, np.intp), np.zeros(key.size, np.intp)
    else:
        keys = np.unique(key)
        which = np.searchsorted(keys, key)
        first = _first_rows(which, keys.size)
    if words > 1 and (bits != bits[first[which]]).any():  # two names share a key
        return _distinct_texts(buffer, start, end)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(order.size)
    return Distinct(first[order], rank[which])


def _plain(buffer: Bytes, start: Places, end: Places) -> tuple[Vector, NDArray[np.bool_]]:
    """Values of the cells that are plain decimals, and which these are."""
    minus = buffer[start] == ord("-")
    at = start + minus
    length = end - at
    mantissa = np.zeros(at.size, np.int64)
    decimals = np.zeros(at.size, np.intp)
    digits = np.zeros(at.size, np.int8)
    points = np.zeros(at.size, np.int8)
    shortest = int(length.min())
    for place in range(min(int(length.max()), _DIGITS)):
        character = buffer[at]
        at += 1
        digit = character - np.uint8(ord("0"))  # wraps: all that is no digit is above 9
        is_digit = digit < 10
        is_point = character == ord(".")
        if place >= shortest:
            inside = length > place
            is_digit &= inside
            is_point &= inside
        if is_point.any():
            decimals[is_point] = length[is_point] - 1 - place
            points += is_point
        digits += is_digit
        mantissa = np.where(is_digit, mantissa * 10 + digit, mantissa)
    plain = (digits + points == length) & (points <= 1) & (digits > 0) & (mantissa <= _EXACT)
    values = mantissa / _TENS[np.where(plain, decimals, 0)]
    np.negative(values, out=values, where=minus)
    return values, plain


def _distinct_texts(buffer: Bytes, start: Places, end: Places) -> Distinct:
    """Find the different cells of a column one by one."""
    texts = _texts(buffer, start, end)
    number = {text: i for i, text in enumerate(dict.fromkeys(texts))}
    which = np.fromiter((number[text] for text in texts), np.intp, len(texts))
    return Distinct(_first_rows(which, len(number)), which)


def _texts(buffer: Bytes, start: Places, end: Places) -> list[bytes]:
    data = buffer.tobytes() if start.size else b""
    return [data[a:b] for a, b in zip(start.tolist(), end.tolist(), strict=True)]


def _first_rows(which: Places, count: int) -> Places:
    first = np.empty(count, np.intp)
    first[which[::-1]] = np.arange(which.size - 1, -1, -1)  # of several, the last one written stays
    return first
