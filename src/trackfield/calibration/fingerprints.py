"""Signal-strength models of a site learned from a survey of fingerprints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackfield.calibration.rssi_site import CalibratedRssi, learn
from trackfield.calibration.scatter import scatter_of_each
from trackfield.network.fingerprints import Fingerprints
from trackfield.network.radio_map import rssi_models
from trackfield.network.site import Site
from trackfield.types import Vector

_LEAST_DB = 0.3  # scatter of readings that are rounded to whole dB


def calibrate_fingerprints(site: Site, survey: Fingerprints) -> CalibratedRssi:
    """Learn the models of all receivers of `site` from a `survey`, which becomes the site's own.

    See `rssi_site.learn`, with its errors. Readings scatter in one place as the survey says, by the
    root mean square of its deviations, for bodies that pass are a part of what a reading will meet;
    or as the site says, if the survey does not.
    """
    found = learn(site, survey, still_db=_still(site, survey))
    return replace(found, site=replace(found.site, survey=survey))


def _still(site: Site, survey: Fingerprints) -> Vector:
    models = rssi_models(site)
    told = np.isfinite(survey.std_db) & ~(survey.count < 2.0)
    square = np.where(told, survey.std_db, 0.0) ** 2
    free = told.astype(float)
    found = scatter_of_each(square, free, sensor=survey.sensor, count=len(models))
    if found is None:
        found = np.sqrt([max(model.sigma_db**2 - model.fading_db**2, 0.0) for model in models])
    return np.maximum(found, _LEAST_DB)
