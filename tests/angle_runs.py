"""Sites of bearings, angular rates and motion, and readings of targets on them."""

import numpy as np

from trackfield.filtering import angle_readings
from trackfield.filtering.scans import Scan
from trackfield.network.site import Site, Target

CORNERS = np.array([[3.0, 1.5], [-3.0, 1.5], [-3.0, -1.5], [3.0, -1.5]])


def site_of(models, places, target=None):
    places = np.asarray(places, float)
    if places.shape[1] == 2:
        places = np.column_stack([places, np.full(len(places), np.nan)])
    names = tuple(f"s{i}" for i in range(len(places)))
    return Site("field", names, places, tuple(models), target=target or Target())


def straight(steps, dt_s, start=(-2.5, 0.3), velocity=(0.6, 0.05)):
    """States (steps, 4) of a target that goes straight."""
    velocity = np.array(velocity, float)
    t = dt_s * np.arange(steps)
    return np.column_stack([start + t[:, None] * velocity, np.tile(velocity, (steps, 1))])


def round_trip(steps, dt_s, radius_m=1.2, turn_s=12.0):
    """States (steps, 4) on a circle about the origin."""
    w = 2 * np.pi / turn_s
    a = w * dt_s * np.arange(steps)
    along, aside = np.cos(a), np.sin(a)
    return radius_m * np.column_stack([along, aside, -w * aside, w * along])


def scans(site, path, dt_s, rng, *, each=None, outliers=0.0):
    """Scans of all sensors, or of `each` that many in turn, of a target on `path`."""
    sensors = angle_readings.of_site(site)
    n = len(site.sensor_ids)
    for k, state in enumerate(path):
        rows = np.arange(n) if each is None else (each * k + np.arange(each)) % n
        some = angle_readings.chosen(sensors, rows)
        noise = some.sigma * rng.standard_normal(rows.size)
        noise *= np.where(rng.random(rows.size) < outliers, 20.0, 1.0)
        value = angle_readings.expected(some, state) + noise
        yield Scan(k * dt_s, rows.astype(np.int32), value, np.full(rows.size, np.nan))


def run(tracker, readings):
    """States after every scan."""
    states = [tracker.start()]
    for scan in readings:
        states.append(tracker.step(states[-1], scan))
    return states[1:]
