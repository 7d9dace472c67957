"""Scenes of a target that passes sensors, in the layout of the issue: km and s."""

from __future__ import annotations

import numpy as np

from trackfield.localization.pass_messages import PassMessages, common_records
from trackfield.sensing import profile as profiles
from trackfield.sensing.amplitude import AmplitudeModel
from trackfield.sensing.pass_profile import predict

X_KM = [-1.20, 0.95, 0.25, -0.60, 1.40, -1.70, -0.30, 1.75, 0.30, -1.85]
X_KM += [-1.50, 0.70, 1.80, 1.60, -1.05, -0.35, 0.55, 1.10, -1.25, 0.15]
Y_KM = [0.80, -0.85, 0.45, -1.10, 0.90, -1.50, 1.60, -0.30, -1.75, 0.15]
Y_KM += [1.75, 1.30, 1.80, -1.60, -0.45, 0.30, -0.25, -0.15, -1.90, 1.95]
LAYOUT = np.column_stack([X_KM, Y_KM])
PASS = np.array([1.0, -2.4, -0.5, 0.196, 0.04])
TIMES = np.arange(25.0)
QUIET = AmplitudeModel(sigma=10.0**-1.25)  # 25 dB at 1 km
NOISY = AmplitudeModel(sigma=10.0**-0.5)  # 10 dB


def messages(n=5, *, theta=PASS, model=QUIET, sensors=None, t_s=TIMES):
    """Messages of the first `n` sensors without any noise."""
    places = LAYOUT[:n] if sensors is None else np.asarray(sensors, float)
    psi = predict(theta, places, exponent=model.exponent).array()
    records = common_records(len(places), t_s)
    return PassMessages(places, (model,) * len(places), psi, records)


def drawn(rng, *, n=5, theta=PASS, model=QUIET, sensors=None, t_s=TIMES):
    """Messages with the errors of their Fisher matrices, as Berger (18) has them."""
    exact = messages(n, theta=theta, model=model, sensors=sensors, t_s=t_s)
    J = profiles.information(profiles.profile_of(exact.profiles), t_s, model)
    noise = np.linalg.solve(
        np.swapaxes(np.linalg.cholesky(J), 1, 2), rng.standard_normal((len(J), 3, 1))
    )
    told = np.maximum(exact.profiles + noise[..., 0], [1e-3, -np.inf, 1e-2])
    return exact._replace(profiles=told)
