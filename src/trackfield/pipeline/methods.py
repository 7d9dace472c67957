"""Which tracker serves which data: by the site's `tracker.method`, and by what the data are."""

from __future__ import annotations

from trackfield.association.bernoulli import Bernoulli
from trackfield.association.bernoulli_settings import BernoulliSettings
from trackfield.association.contract import AnyAssociator
from trackfield.association.model import Scene
from trackfield.errors import ConfigurationError
from trackfield.network.site import Site
from trackfield.pipeline.fronts import DetectionFront, Front, ReportFront, SignalFront, Source


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
    """Make the tracker of reports that the site's `tracker.method` names."""
    window = site.tracker.window_steps
    match site.tracker.method:
        case "bernoulli":
            return Bernoulli(scene, BernoulliSettings(window_steps=window, history_steps=window))
        case "jipda":
            collapsed = BernoulliSettings(recent_scans=0, window_steps=window, history_steps=window)
            return Bernoulli(scene, collapsed)
        case _:
            raise ConfigurationError(
                [f"site {site.name}: tracker.method: found {site.tracker.method!r}"]
            )
