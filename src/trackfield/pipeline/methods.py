"""Which tracker serves which data: by the site's `tracker.method`, and by what the data are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackfield.association.bernoulli import Bernoulli
from trackfield.association.bernoulli_settings import BernoulliSettings
from trackfield.association.contract import AnyAssociator
from trackfield.association.mcmcda import Mcmcda
from trackfield.association.model import Scene
from trackfield.association.nearest import Nearest
from trackfield.association.nearest_step import NearestSettings
from trackfield.association.sampling import Sampling
from trackfield.errors import ConfigurationError
from trackfield.hierarchy.field import tracked_field
from trackfield.network.site import Site, Target
from trackfield.pipeline.fronts import DetectionFront, Front, ReportFront, SignalFront, Source

_LONGEST_WINDOW = 64  # steps that MCMCDA samples


def front_of(site: Site, scene: Scene, *, source: Source) -> Front:
    """Make what turns tables of a source into scans; `ConfigurationError` for a wrong site."""
    match source:
        case "reports":
            return ReportFront(site, scene.reporting.region)
        case "signal":
            return SignalFront(site)
        case "detection":
            return DetectionFront(site)


def associator_of(site: Site, scene: Scene, *, seed: int) -> AnyAssociator:
    """Make the tracker of reports that the site names: one, or one a group and their base.

    `ConfigurationError` for groups that are not there.
    """
    if not site.tracker.by_group:
        return _one(site, scene, seed=seed)
    if len(site.groups) < 2:
        found = f"found tracker.by_group = true and {len(site.groups)} of them"
        raise ConfigurationError([f"site {site.name}: groups: {found}, expected two or more"])
    centres = np.array([[group.x_m, group.y_m] for group in site.groups])
    return tracked_field(scene, centres, tracker=lambda part: _one(site, part, seed=seed))


def _one(site: Site, scene: Scene, *, seed: int) -> AnyAssociator:
    """Make one tracker by the site's `tracker.method`."""
    window = site.tracker.window_steps
    match site.tracker.method:
        case "bernoulli":
            return Bernoulli(scene, BernoulliSettings(window_steps=window, history_steps=window))
        case "jipda":
            one_gaussian = BernoulliSettings(
                recent_scans=0, window_steps=window, history_steps=window
            )
            return Bernoulli(scene, one_gaussian)
        case "mcmcda":
            return Mcmcda(scene, _sampling(site, seed))
        case "gnn":
            return Nearest(scene, NearestSettings(pairing="optimal", window_steps=window))
        case "nearest":
            return Nearest(scene, NearestSettings(pairing="greedy", window_steps=window))


def _sampling(site: Site, seed: int) -> Sampling:
    """Sample the window that late reports need, and no less than the usual one."""
    usual = Sampling()
    window = min(max(usual.window, site.tracker.window_steps), _LONGEST_WINDOW)
    told = site.target.max_speed_m_s
    speed = None if told == Target().max_speed_m_s else told
    return replace(usual, window=window, max_speed_m_s=speed, seed=seed)
