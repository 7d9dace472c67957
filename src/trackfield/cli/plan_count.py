"""`trackfield plan SITE --rms M`: how many nodes the region needs for a wanted accuracy."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

from trackfield.cli.answers import Answer
from trackfield.cli.plan_map import in_plane, region_of
from trackfield.errors import ConfigurationError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from trackfield.network.site import Site
    from trackfield.scheduling.provision import Layout, Provision


LAYOUTS = ("hexagonal", "square", "random")
_MOST = 5000  # nodes, with which a trial still takes seconds


def answer(site: Site, rms_m: float, *, layout: str, seed: int) -> Answer:
    """Count nodes like the site's first sensor that locate within `rms_m` nearly anywhere."""
    from trackfield.scheduling.provision import Wanted, nodes_needed

    if layout not in LAYOUTS:
        expected = ", ".join(LAYOUTS)
        raise ConfigurationError([f"--layout: found {layout!r}, expected one of: {expected}"])
    if not 0.0 < rms_m < np.inf:
        raise ConfigurationError([f"--rms: found {rms_m:g}, expected an error above 0 in metres"])
    in_plane(site)
    wanted, area = Wanted(rms_m), region_of(site)
    rng = np.random.default_rng(seed) if layout == "random" else None
    chosen = cast("Layout", layout)
    found = nodes_needed(area, site.models[0], wanted=wanted, layout=chosen, most=_MOST, rng=rng)
    reached, share = found.reached, f"{100.0 * wanted.share:g} %"
    numbers = {
        "wanted_rms_m": rms_m,
        "share": wanted.share,
        "layout": layout,
        "enough": found.enough,
        "nodes": found.number,
        "spacing_m": found.spacing_m or None,
        "reached_share": reached.share,
        "reached_rms_m": reached.rms_m if np.isfinite(reached.rms_m) else None,
    }
    apart = f", {found.spacing_m:.3g} m apart" if found.spacing_m else ""
    if found.enough:
        lines = [
            f"{found.number} nodes like {site.sensor_ids[0]} are enough, {layout}{apart}: "
            f"rms error {reached.rms_m:.3g} m or less in {share} of the region"
        ]
        doubts: list[str] = []
    else:
        lines = []
        doubts = [
            f"found no number of nodes up to {found.number} that is enough: an rms error of "
            f"{rms_m:g} m holds in {100.0 * reached.share:.3g} % of the region at best"
        ]
    return Answer(
        numbers, lines, doubts=doubts, figure=lambda: _figure(site, found), failed=not found.enough
    )


def _figure(site: Site, found: Provision) -> Figure:
    from trackfield.plotting.choices import plot_nodes

    title = f"{found.number} nodes for {site.name}"
    return plot_nodes(found.nodes, region_of(site), title=title)
