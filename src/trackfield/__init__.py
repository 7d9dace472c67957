"""trackfield: from the readings of a field of cheap sensors to tracks.

The flow, in the order of the rooms:

    io            readings come in from files, tracks go out
    network       the site: sensors, their places, and which model each has
    sensing       what one sensor says of a target: expectation, noise, statistics
    localization  readings of one moment -> positions
    filtering     belief over time: Kalman filters, mixtures of motions, smoothing
    association   which report belongs to which target, where none is named
    hierarchy     tracking groups side by side: hand-over, fusion of their tracks
    scheduling    who senses next, so that the network lasts; tracks in, commands out
    robot         follows a target within a hop of those that sense it; obstacles
    pursuit       who chases whom, and how; tracks in, orders out
    pipeline      the stages joined: process / snapshot / restore
    calibration   a run with truth -> the sensors' models
    metrics       tracks against truth

This module loads its names when they are first used, because NumPy alone would take longer to
import than `trackfield --help` may.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from trackfield.api import calibrate, score, track
    from trackfield.errors import ConfigurationError, InputError, StateError, TrackfieldError
    from trackfield.io.measurements import (
        read_readings,
        readings_from_columns,
        stream_readings,
        write_readings,
    )
    from trackfield.io.reports import (
        read_reports,
        reports_from_columns,
        stream_reports,
        write_reports,
    )
    from trackfield.io.tracks import read_tracks, write_tracks
    from trackfield.io.truth import read_truth, write_truth
    from trackfield.network.site import Site
    from trackfield.network.site_file import load_site, site_from_toml
    from trackfield.network.site_writer import write_site
    from trackfield.pipeline.commands import Commander
    from trackfield.pipeline.extent import settled
    from trackfield.pipeline.pursuing import Pursuit
    from trackfield.pipeline.tagged import Tracker
    from trackfield.pipeline.untagged import Feed, UntaggedTracker
    from trackfield.sensing.detection import DetectionModel
    from trackfield.sensing.range import RangeModel
    from trackfield.sensing.signal import SignalModel
    from trackfield.types import Commands, Mode, Readings, Reports, Status, Tracks, Truth

__version__ = "0.4.0"

_ROOMS = {
    "api": ("calibrate", "score", "track"),
    "errors": ("ConfigurationError", "InputError", "StateError", "TrackfieldError"),
    "io.measurements": (
        "read_readings",
        "readings_from_columns",
        "stream_readings",
        "write_readings",
    ),
    "io.reports": (
        "read_reports",
        "reports_from_columns",
        "stream_reports",
        "write_reports",
    ),
    "io.tracks": ("read_tracks", "write_tracks"),
    "io.truth": ("read_truth", "write_truth"),
    "network.site": ("Site",),
    "network.site_file": ("load_site", "site_from_toml"),
    "network.site_writer": ("write_site",),
    "pipeline.commands": ("Commander",),
    "pipeline.extent": ("settled",),
    "pipeline.pursuing": ("Pursuit",),
    "pipeline.tagged": ("Tracker",),
    "pipeline.untagged": ("Feed", "UntaggedTracker"),
    "sensing.detection": ("DetectionModel",),
    "sensing.range": ("RangeModel",),
    "sensing.signal": ("SignalModel",),
    "types": ("Commands", "Mode", "Readings", "Reports", "Status", "Tracks", "Truth"),
}
_ROOM_OF = {name: room for room, names in _ROOMS.items() for name in names}

__all__ = [
    "Commander",
    "Commands",
    "ConfigurationError",
    "DetectionModel",
    "Feed",
    "InputError",
    "Mode",
    "Pursuit",
    "RangeModel",
    "Readings",
    "Reports",
    "SignalModel",
    "Site",
    "StateError",
    "Status",
    "Tracker",
    "TrackfieldError",
    "Tracks",
    "Truth",
    "UntaggedTracker",
    "__version__",
    "calibrate",
    "load_site",
    "read_readings",
    "read_reports",
    "read_tracks",
    "read_truth",
    "readings_from_columns",
    "reports_from_columns",
    "score",
    "settled",
    "site_from_toml",
    "stream_readings",
    "stream_reports",
    "track",
    "write_readings",
    "write_reports",
    "write_site",
    "write_tracks",
    "write_truth",
]


def __getattr__(name: str) -> object:
    """Load a public name from the room that defines it."""
    if name not in _ROOM_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_ROOM_OF[name]}"), name)
    globals()[name] = value  # the next time it is simply there
    return value


def __dir__() -> list[str]:
    """List the public names, loaded or not."""
    return sorted({*globals(), *__all__})
