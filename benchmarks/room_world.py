"""A home of 6 x 4 m with a receiver in each corner: somebody walks from place to place and rests.

The world of the published figures for the tracking of people at home by the strength of a beacon:
sigma 2.5 dB, and a tenth of the time a body in the way that takes 6 dB. Position errors and flips
of rooms are measured in it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.network.site import Room, Site, Target
from trackfield.sensing.rssi import RssiModel
from trackfield.sensing.rssi_world import simulate
from trackfield.types import Readings, Truth

WIDTH_M, DEPTH_M = 6.0, 4.0
MODEL = RssiModel(
    power_dbm=-59.0,
    exponent=2.0,
    sigma_db=2.5,
    p_blocked=0.1,
    blocked_db=6.0,
    blocked_sigma_db=0.0,
    burst_s=2.0,
)
ROOMS = (
    Room("bedroom", ((0.0, 0.0), (2.4, 0.0), (2.4, 2.2), (0.0, 2.2))),
    Room("kitchen", ((2.4, 0.0), (6.0, 0.0), (6.0, 1.6), (2.4, 1.6))),
    Room("bath", ((0.0, 2.2), (2.4, 2.2), (2.4, 4.0), (0.0, 4.0))),
    Room("parlour", ((2.4, 1.6), (6.0, 1.6), (6.0, 4.0), (2.4, 4.0))),
)
_CLEAR_M = 0.4  # of walls, where somebody rests
_SPEED_M_S = (0.5, 1.2)
_REST_S = (20.0, 60.0)


class RoomRun(NamedTuple):
    """A run in the home: what the receivers said, where the beacon was, and where it rested.

    `rest` (k, 2) holds begin and end [s] of each rest, `rest_room` (k,) its number in `ROOMS`.
    """

    site: Site
    readings: Readings
    truth: Truth
    rest: NDArray[np.float64]
    rest_room: NDArray[np.int32]


class _Walk(NamedTuple):
    t_s: NDArray[np.float64]
    corner: NDArray[np.float64]
    rest: NDArray[np.float64]
    room: NDArray[np.int32]


def room_run(
    seed: int, *, rate_hz: float = 1.0, duration_s: float = 600.0, model: RssiModel = MODEL
) -> RoomRun:
    """Draw a run; each receiver hears the beacon `rate_hz` times a second, at times of its own.

    Somebody rests in a room at random, `_CLEAR_M` or more from its walls, then walks straight to
    the next place.
    """
    rng = np.random.default_rng(seed)
    walk = _walk(rng, duration_s)
    site = room_site(model)
    period = 1.0 / rate_hz
    ticks = np.arange(0.0, duration_s, period)
    # Advertisements come with a random delay, as the standard has it.
    times = ticks[:, None] + rng.uniform(0.0, 0.3 * period, (ticks.size, len(site.sensor_ids)))
    order = np.argsort(times, axis=None)
    t = times.ravel()[order]
    sensor = np.tile(np.arange(4, dtype=np.int32), ticks.size)[order]
    drawn = simulate(model, site.positions[:, :2], path=_at(walk, t), t_s=t, rng=rng)
    rows = np.arange(t.size)
    heard = drawn.heard[rows, sensor]
    value = drawn.value[rows, sensor][heard]
    n = value.size
    readings = Readings(
        t_s=t[heard],
        sensor=sensor[heard],
        value=value,
        target=np.zeros(n, np.int32),
        kind=np.zeros(n, np.int32),
        sigma=np.full(n, np.nan),
        arrival_s=np.full(n, np.nan),
        sensor_ids=site.sensor_ids,
        target_ids=("somebody",),
        kinds=("rssi",),
    )
    known = np.arange(0.0, duration_s, 0.1)
    place = np.column_stack([_at(walk, known), np.full(known.size, np.nan)])
    truth = Truth(known, np.zeros(known.size, np.int32), place, ("somebody",))
    return RoomRun(site, readings, truth, walk.rest, walk.room)


def room_site(model: RssiModel = MODEL) -> Site:
    """Make the home: four receivers in the corners, and four rooms."""
    corners = [(0.0, 0.0), (WIDTH_M, 0.0), (WIDTH_M, DEPTH_M), (0.0, DEPTH_M)]
    return Site(
        name="home",
        sensor_ids=("south-west", "south-east", "north-east", "north-west"),
        positions=np.array([(*corner, np.nan) for corner in corners]),
        models=(model,) * 4,
        target=Target(max_speed_m_s=2.0),
        rooms=ROOMS,
    )


def _walk(rng: np.random.Generator, duration_s: float) -> _Walk:
    t, room, times, corners = 0.0, 0, [0.0], [_place(rng, 0)]
    rest: list[list[float]] = []
    rooms: list[int] = []
    while t < duration_s:
        end = t + rng.uniform(*_REST_S)
        rest.append([t, end])
        rooms.append(room)
        room = int(rng.choice([other for other in range(len(ROOMS)) if other != room]))
        place = _place(rng, room)
        arrival = end + float(np.linalg.norm(place - corners[-1])) / rng.uniform(*_SPEED_M_S)
        times += [end, arrival]
        corners += [corners[-1], place]
        t = arrival
    return _Walk(np.array(times), np.array(corners), np.array(rest), np.array(rooms, np.int32))


def _place(rng: np.random.Generator, room: int) -> NDArray[np.float64]:
    corners = np.array(ROOMS[room].polygon)
    low, high = corners.min(axis=0) + _CLEAR_M, corners.max(axis=0) - _CLEAR_M
    return low + rng.random(2) * (high - low)


def _at(walk: _Walk, t: NDArray[np.float64]) -> NDArray[np.float64]:
    x, y = (np.interp(t, walk.t_s, walk.corner[:, axis]) for axis in (0, 1))
    return np.column_stack([x, y])
