"""How good the three numbers of an energy message are: noise, rounding, and the sensor's clock."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trackfield.linalg import covariance_of
from trackfield.sensing.energy_message import (
    EnergyMessageModel,
    amplitude_model,
    decode,
    encode,
    sample_times,
)
from trackfield.sensing.profile import Profile, information
from trackfield.types import Matrix, Vector


def message_information(
    model: EnergyMessageModel,
    profile: Profile,
    *,
    end_s: float | Vector,
    rounding: Matrix | None = None,
) -> Matrix:
    """Information (..., 3, 3) J (I + Q J)^-1 that messages hold about profiles (...).

    J is the Fisher matrix of the samples, Berger (16), (42), at `profile`; Q is the covariance of
    rounding (from `decode`; none if not given) and of the clock, which adds clock_sigma_s^2 to the
    time's. It may be evaluated at the profile of a fused trajectory.
    """
    t_max = np.asarray(profile.t_max_s, float) - end_s
    t_s = sample_times(model)
    J = information(profile._replace(t_max_s=t_max), t_s, amplitude_model(model))
    clock = np.diag([0.0, model.clock_sigma_s**2, 0.0])
    Q = clock if rounding is None else clock + rounding
    # divided by sizes first: amplitudes and times may be of very different units
    size = np.sqrt(np.maximum(np.diagonal(J, axis1=-2, axis2=-1), np.finfo(float).tiny))
    white = J / size[..., None] / size[..., None, :]
    spread = np.eye(3) + size[..., None] * Q * size[..., None, :] @ white
    out = np.linalg.solve(np.swapaxes(spread, -1, -2), white)
    out = 0.5 * (out + np.swapaxes(out, -1, -2))
    return out * size[..., None] * size[..., None, :]


def encoding_cost(
    model: EnergyMessageModel, profile: Profile, *, end_s: float | Vector = 0.0, bits: int
) -> Matrix:
    """Factor (..., 3) by which the bound of each of the three numbers grows if sent in `bits` each.

    sqrt(diag(J^-1 + Q) / diag(J^-1)), Q the covariance of rounding at `profile`.
    """
    coarse = replace(model, bits=bits, clock_sigma_s=0.0)
    told = decode(coarse, encode(coarse, profile, end_s=end_s), end_s=end_s)
    bound = covariance_of(message_information(coarse, profile, end_s=end_s)).value
    exact = np.diagonal(bound, axis1=-2, axis2=-1)
    return np.sqrt(1.0 + np.diagonal(told.covariance, axis1=-2, axis2=-1) / exact)
