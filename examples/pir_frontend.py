"""From a raw PIR waveform to detections: which front end, and with which p and q.

A person walks past a sensor every half minute. The waveform goes through both front ends, second by
second as on a node; since it is known when the person was there, p and q can be counted.
"""

import math

import numpy as np

from trackfield.sensing.detection_rates import measured_rates
from trackfield.sensing.pir import PirWorld, simulate_pir
from trackfield.sensing.waveform import PIR, FixedThreshold, FrontEnd, initial, join_windows, step

RATE_HZ, VISITS, EVERY_S, SPEED_M_S, RADIUS_M = 40.0, 60, 30.0, 1.2, 7.62

rng = np.random.default_rng(1)
t = np.arange(int(VISITS * EVERY_S * RATE_HZ)) / RATE_HZ
paths = np.full((t.size, 1, 2), np.nan)  # nobody there
intervals = []
for visit in range(VISITS):
    aside, turn = rng.uniform(-6, 6), rng.uniform(0, 2 * math.pi)
    begin = visit * EVERY_S + rng.uniform(0, EVERY_S - 20 / SPEED_M_S)
    now = (t >= begin) & (t < begin + 20 / SPEED_M_S)
    along = SPEED_M_S * (t[now] - begin) - 10
    c, s = math.cos(turn), math.sin(turn)
    paths[now, 0] = np.stack([c * along - s * aside, s * along + c * aside], axis=1)
    half = math.sqrt(RADIUS_M**2 - aside**2)
    intervals.append([begin + (10 - half) / SPEED_M_S, begin + (10 + half) / SPEED_M_S])

days = {"mild day": PirWorld(), "hot day": PirWorld(drift_v=0.4, plumes_per_s=0.05, plume_v=0.8)}
detectors = {"fixed .25 V": FixedThreshold(0.25), "adaptive": PIR}
for day, world in days.items():
    waveform = simulate_pir(world, paths, rate_hz=RATE_HZ, rng=rng)
    for name, detector in detectors.items():
        front = FrontEnd(RATE_HZ, detector)
        state, said = initial(front), []
        for chunk in np.array_split(waveform, t.size // 25):  # as samples come in
            state, windows = step(front, state, chunk)
            said.append(windows)
        found = join_windows(said)
        rates = measured_rates(
            found.end_s, found.detected, window_s=1.0, intervals=np.array(intervals)
        )
        print(
            f"{day}, {name}: p = {rates.p_detection:.2f} +- {rates.p_error:.2f}, "
            f"q = {rates.p_false:.3f} +- {rates.q_error:.3f}"
        )
