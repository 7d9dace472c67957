"""Snapshots as sealed bytes: what made them, and whether they are still whole."""

from __future__ import annotations

import hashlib
import struct

from trackfield.errors import StateError

_MAGIC = b"TRACKFLD"
_VERSION = 1
_HEAD = len(_MAGIC) + 2


def fingerprint(*parts: object) -> bytes:
    """Digest of what an operator was made from, by the `repr` of each part."""
    return hashlib.sha256(repr(parts).encode()).digest()


def seal(body: bytes, maker: bytes) -> bytes:
    """Put a head before the body: magic, version, the maker's fingerprint, the body's digest."""
    own = hashlib.sha256(body).digest()
    return b"".join((_MAGIC, struct.pack("<H", _VERSION), maker, own, body))


def unseal(data: bytes, maker: bytes) -> bytes:
    """Take the body out again; `StateError` for other bytes, versions, makers, or damage."""
    if data[: len(_MAGIC)] != _MAGIC or len(data) < _HEAD + 68:
        raise StateError("found bytes that are not a tracker's snapshot")
    (version,) = struct.unpack_from("<H", data, len(_MAGIC))
    if version != _VERSION:
        raise StateError(f"found a snapshot of version {version}, expected {_VERSION}")
    if data[_HEAD : _HEAD + 32] != maker:
        raise StateError("found a snapshot of another site or of other options than this tracker's")
    body = data[_HEAD + 64 :]
    if data[_HEAD + 32 : _HEAD + 64] != hashlib.sha256(body).digest():
        raise StateError("found a damaged snapshot: its bytes do not match their own digest")
    return body
