"""Files that get their name only when they are complete."""

from __future__ import annotations

import os
import secrets
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from trackfield.errors import InputError


@contextmanager
def replacing(path: Path) -> Generator[BinaryIO]:
    """Open a file for writing that becomes `path` when the block ends, and never if it fails.

    It is made beside `path` at once, so that a place that cannot be written is told before the
    work starts, with `InputError`. A pipe or a device has no beside: it is written directly.
    """
    target = Path(os.path.realpath(path))  # a link stays one
    if target.is_dir():
        raise InputError(f"{path}: cannot be written: found a folder, expected a file")
    if target.exists() and not target.is_file():
        with saying(path):
            file = target.open("wb")
        with file:
            yield file
        return
    draft = target.with_name(f".trackfield-{secrets.token_hex(8)}.tmp")
    with saying(path):
        if target.exists():
            target.open("ab").close()  # may it be written at all?
        file = draft.open("xb")
    try:
        with file:
            yield file
            with saying(path):
                file.flush()
        with saying(path):
            draft.replace(target)
    except BaseException:  # an interrupt too must leave nothing behind
        draft.unlink(missing_ok=True)
        raise


@contextmanager
def saying(path: Path) -> Generator[None]:
    """Turn trouble of the system inside the block into an `InputError` about `path`."""
    try:
        yield
    except FileNotFoundError:
        raise InputError(f"{path}: cannot be written: found no folder {path.parent}") from None
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"{path}: cannot be written: {reason}") from error
