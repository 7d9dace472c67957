"""Who is awake beside those that sense: around targets, in search of one, and at the border."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackfield.network.site import SchedulingSettings
from trackfield.raster import Region
from trackfield.scheduling.activation import Zone, activate
from trackfield.scheduling.recovery import search_believed
from trackfield.scheduling.serving import Sensors
from trackfield.scheduling.watch import Watch, on_duty
from trackfield.types import Indices, Matrix, Vector

_FOUND = 0.99  # probability with which a target is where it is looked for
_WATCHERS = 3  # nodes that hear who comes in: fewer do not locate it by ranges
_SHIFT_S = 60.0  # after which others watch


class Look(NamedTuple):
    """Who looks for a target; `whole`: everywhere, so that it is the last time; `gone`: it left."""

    nodes: Indices
    whole: bool
    gone: bool


def region_nodes(
    sensors: Sensors,
    means: Matrix,
    *,
    spreads: Vector,
    radius_m: float,
    settings: SchedulingSettings,
) -> Indices:
    """Nodes (m,) of the regions R that targets will have until `ahead_s`, Pham 2.2.2.

    States `means` (t, 4) of some targets hold now; `spreads` (t,) [m] is how far off they may be. A
    disc around where a target will be, and a sector ahead of it, both so much wider than
    `radius_m`, within which enough nodes stand.
    """
    ahead = settings.interval_s if settings.ahead_s is None else settings.ahead_s
    steps = settings.interval_s * np.arange(1, math.ceil(ahead / settings.interval_s - 1e-9) + 1)
    if not steps.size:
        steps = np.zeros(1)
    places = means[:, :2] + steps[:, None, None] * means[:, 2:]
    headings = np.broadcast_to(means[:, 2:], places.shape)
    wide = float(spreads.max())
    near, far = settings.near * radius_m + wide, settings.far * radius_m + wide
    zone = Zone(near, max(near, far), math.radians(settings.alpha_deg))
    found = activate(
        sensors.nodes, places.reshape(-1, 2), headings=headings.reshape(-1, 2), zone=zone
    )
    return np.unique(found.node)


def look_for(sensors: Sensors, means: Matrix, *, covariances: Matrix, region: Region) -> list[Look]:
    """Look for missed targets where they may be by now: in wider and wider ellipses.

    `means` (t, 2) [m] and `covariances` (t, 2, 2) are of the positions now.
    """
    if not len(means):
        return []
    found = search_believed(
        sensors.nodes,
        means,
        covariances=covariances,
        probability=_FOUND,
        reach_m=sensors.farthest_m,
        field=region,
    )
    return [
        Look(found.node[found.track == i], bool(found.whole[i]), bool(found.gone[i]))
        for i in range(len(means))
    ]


def watchers(watch: Watch, t_s: float, *, alive: NDArray[np.bool_]) -> Indices:
    """Nodes (m,) that watch the border at `t_s`: three shifts at a time, others every minute.

    A shift in which a node is dead does not count, but for what it still sees.
    """
    count = len(watch.shifts)
    chosen, whole = [np.empty(0, np.int32)], 0
    for turn in range(count):
        nodes = on_duty(watch, int(t_s // _SHIFT_S) * _WATCHERS + turn)
        chosen.append(nodes[alive[nodes]])
        whole += bool(alive[nodes].all())
        if whole == _WATCHERS:
            break
    return np.concatenate(chosen)
