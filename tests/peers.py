"""Scores by Stone Soup and py-motmetrics, as oracles; what they warn of is theirs."""

from __future__ import annotations

import datetime
import warnings

import numpy as np

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import motmetrics
    from stonesoup.dataassociator.tracktotrack import TrackToTruth
    from stonesoup.measures import Euclidean
    from stonesoup.metricgenerator.manager import MultiManager
    from stonesoup.metricgenerator.ospametric import GOSPAMetric, OSPAMetric
    from stonesoup.metricgenerator.tracktotruthmetrics import SIAPMetrics
    from stonesoup.types.groundtruth import GroundTruthPath
    from stonesoup.types.state import State
    from stonesoup.types.track import Track

START = datetime.datetime(2024, 1, 1, tzinfo=datetime.UTC)


def set_distances(truth, shown, *, cutoff_m, order):
    """OSPA, GOSPA and its parts (localisation, missed, false; the latter as costs) of two sets."""
    targets, tracks = ([_state(0.0, place) for place in places] for places in (truth, shown))
    gospa = GOSPAMetric(c=cutoff_m, p=order)
    found, _ = gospa.compute_gospa_metric(tracks, targets)
    ospa = OSPAMetric(c=cutoff_m, p=order).compute_OSPA_distance(tracks, targets)
    parts = found.value
    return ospa.value, parts["distance"], parts["localisation"], parts["missed"], parts["false"]


def siap(truth, shown, *, match_m):
    """SIAP by name; `truth` and `shown` are lists of {t_s: (x, y)}, one an identity."""
    targets = {GroundTruthPath([_state(t, one[t]) for t in sorted(one)]) for one in truth}
    tracks = {Track([_state(t, one[t]) for t in sorted(one)]) for one in shown}
    near = TrackToTruth(association_threshold=match_m, consec_pairs_confirm=1, consec_misses_end=1)
    generator = SIAPMetrics(position_measure=Euclidean((0, 1)), velocity_measure=Euclidean((0, 1)))
    manager = MultiManager([generator], associator=near)
    manager.add_data({"groundtruth_paths": targets, "tracks": tracks})
    manager.associate_tracks(generator)
    return {metric.title: metric.value for metric in generator.compute_metric(manager)}


def clear_and_identity(steps, *, match_m):
    """CLEAR-MOT and IDF1 by name, of `trackfield.metrics.steps.Steps`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        events = motmetrics.MOTAccumulator()
        for k in range(steps.t_s.size):
            a, b = steps.truth.step == k, steps.shown.step == k
            distance = np.linalg.norm(
                steps.truth.position[a][:, None] - steps.shown.position[b][None], axis=2
            )
            distance[distance >= match_m] = np.nan
            events.update(steps.truth.who[a], steps.shown.who[b], distance, frameid=k)
        names = motmetrics.metrics.motchallenge_metrics[:15]
        return motmetrics.metrics.create().compute(events, metrics=names).iloc[0].to_dict()


def _state(t_s, place):
    return State(np.reshape(place, (-1, 1)), timestamp=START + datetime.timedelta(seconds=t_s))
