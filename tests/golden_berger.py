"""Golden kinds of energy profiles, Berger et al.."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

Case = dict[str, Any]
Answer = dict[str, Any]

KINDS: dict[str, Callable[[Case], Answer]] = {}
