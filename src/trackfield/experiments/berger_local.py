"""Berger, Figs. 5, 6, 9 and 10: what each sensor makes of its own samples, against its bound."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from trackfield.experiments import berger_local_tables
from trackfield.experiments.berger_local_tables import (
    ASTRAY,
    BITS,
    SETUPS,
    SMOOTHING_S,
    SNR_DB,
    BergerLocal,
    EncodingCost,
    ExampleProfile,
    LocalErrors,
    Setup,
)
from trackfield.experiments.results import Table
from trackfield.linalg import covariance_of
from trackfield.sensing import amplitude
from trackfield.sensing.amplitude import AmplitudeModel
from trackfield.sensing.energy_message import EnergyMessageModel, decode, encode
from trackfield.sensing.energy_message_accuracy import encoding_cost
from trackfield.sensing.pass_profile import predict
from trackfield.sensing.profile import Profile, expected, information
from trackfield.sensing.profile_fit import Quality, fit
from trackfield.types import Matrix, Vector

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SENSORS_KM = np.array([[-1.20, 0.80], [0.95, -0.85], [0.25, 0.45]])
"""The first three of our layout: the paper draws its sensors and prints no places."""
THETA = np.array([1.0, -2.4, -0.5, 0.196, 0.04])  # P at 1 km, x0 [km], v [km/s]
RECORD_S = 24.0


def run(rng: np.random.Generator, *, quick: bool = False) -> BergerLocal:
    """Fit 1000 records (100 if `quick`) of each sensor, part and SNR; the paper takes 1000."""
    runs = 100 if quick else 1000
    return BergerLocal(
        {name: _example(SETUPS[name], rng) for name in ("fig6", "fig10")},
        {name: _errors(setup, runs, rng) for name, setup in SETUPS.items()},
        _encoding(runs, rng),
        runs,
    )


def coarse(t_s: Vector, values: Matrix) -> Profile:
    """Give the paper's coarse estimate (...): the largest sample, and the one nearest to half."""
    top = values.argmax(axis=-1)
    largest = values.max(axis=-1)
    off = np.abs(values - 0.5 * largest[..., None])
    np.put_along_axis(off, top[..., None], np.inf, axis=-1)
    return Profile(largest, t_s[top], np.abs(t_s[off.argmin(axis=-1)] - t_s[top]))


def tables(found: BergerLocal) -> tuple[Table, ...]:
    """Tell the errors of each part against the bound, and what encoding costs."""
    return berger_local_tables.tables(found)


def findings(found: BergerLocal) -> tuple[str, ...]:
    """Say what follows, and what could not be recovered."""
    return berger_local_tables.findings(found)


def figures(found: BergerLocal) -> dict[str, Figure]:
    """Draw Figs. 5, 6, 9, 10 and the cost of encoding with Matplotlib, by file name."""
    from trackfield.experiments.berger_local_figures import figures

    return figures(found)


def _scene(setup: Setup, snr_db: float) -> tuple[Vector, AmplitudeModel, Profile]:
    """Give times, the model of the samples, and what the three sensors see."""
    t_s = np.arange(int(RECORD_S * setup.rate_hz) + 1) / setup.rate_hz
    model = AmplitudeModel(sigma=10.0 ** (-snr_db / 20.0), fading=setup.fading)
    return t_s, model, predict(THETA, SENSORS_KM)


def _draw(
    scene: tuple[Vector, AmplitudeModel, Profile], runs: int, rng: np.random.Generator
) -> Matrix:
    """Draw samples (runs, 3, m)."""
    t_s, model, truth = scene
    mean = expected(truth, t_s)
    return amplitude.noisy(model, np.broadcast_to(mean, (runs, *mean.shape)), rng=rng)


def _coarse_of(setup: Setup, t_s: Vector, values: Matrix) -> Profile:
    if setup.fading == "none":
        return coarse(t_s, values)
    weights = np.exp(-0.5 * np.square((t_s[:, None] - t_s) / SMOOTHING_S))
    return coarse(t_s, values @ (weights / weights.sum(axis=0)))


def _example(setup: Setup, rng: np.random.Generator) -> ExampleProfile:
    scene = _scene(setup, SNR_DB[0])
    t_s, model, truth = scene
    values = _draw(scene, 1, rng)[0]
    return ExampleProfile(
        t_s, values, truth, _coarse_of(setup, t_s, values), fit(model, t_s, values).profile
    )


def _errors(setup: Setup, runs: int, rng: np.random.Generator) -> LocalErrors:
    return LocalErrors(
        *(
            np.stack(part)
            for part in zip(*(_errors_at(setup, snr, runs, rng) for snr in SNR_DB), strict=True)
        )
    )


def _errors_at(
    setup: Setup, snr_db: float, runs: int, rng: np.random.Generator
) -> tuple[Matrix, ...]:
    """One row of each entry of `LocalErrors`."""
    scene = _scene(setup, snr_db)
    t_s, model, truth = scene
    values = _draw(scene, runs, rng)
    bound = _bound(information(truth, t_s, model))
    found, alone = fit(model, t_s, values), fit(model, t_s, values, starts="paper")
    error = np.abs(found.profile.array() - truth.array())
    first = np.abs(_coarse_of(setup, t_s, values).array() - truth.array())
    return (
        bound,
        np.sqrt(np.mean(error**2, axis=0)),
        np.median(error, axis=0) / (0.67449 * bound),
        np.sqrt(np.mean(first**2, axis=0)),
        np.mean(found.quality == Quality.GOOD, axis=0),
        np.mean((error > ASTRAY * bound).any(axis=-1), axis=0),
        np.mean(found.log_likelihood > alone.log_likelihood + 0.5, axis=0),
    )


def _encoding(runs: int, rng: np.random.Generator) -> EncodingCost:
    snrs = (10.0, 20.0, 30.0, 40.0)
    told, measured = (np.empty((len(BITS), len(snrs))) for _ in range(2))
    t_s = np.arange(RECORD_S + 1.0)
    for j, snr in enumerate(snrs):
        model = AmplitudeModel(sigma=10.0 ** (-snr / 20.0))
        factors = np.exp(rng.uniform(-0.1, 0.1, (runs, 5)))
        truth = predict(THETA * factors, SENSORS_KM)
        values = amplitude.noisy(model, expected(truth, t_s), rng=rng)
        found = fit(model, t_s, values).profile
        deviation = _bound(information(truth, t_s, model))
        before = (found.array() - truth.array()) / deviation
        kept = np.asarray((np.abs(before) < ASTRAY).all(axis=-1))
        sent = EnergyMessageModel(sigma=model.sigma, sample_s=1.0, record_s=RECORD_S)
        for i, bits in enumerate(BITS):
            coded = replace(sent, bits=bits)
            back = decode(coded, encode(coded, found, end_s=RECORD_S), end_s=RECORD_S).profile
            after = (back.array() - truth.array()) / deviation
            growth = _rms(after, kept) / _rms(before, kept)
            measured[i, j] = growth.max()
            cost = encoding_cost(sent, truth, end_s=RECORD_S, bits=bits)
            told[i, j] = np.median(cost, axis=0).max()
    return EncodingCost(np.array(snrs), told, measured)


def _rms(errors: Matrix, kept: NDArray[np.bool_]) -> Matrix:
    """Root of the mean square (3, 3) over the runs (runs, 3, 3) that are `kept` (runs, 3)."""
    square = np.sum(np.where(kept[..., None], errors, 0.0) ** 2, axis=0)
    return np.sqrt(square / np.sum(kept, axis=0)[:, None])


def _bound(J: Matrix) -> Matrix:
    return np.sqrt(np.diagonal(covariance_of(J).value, axis1=-2, axis2=-1))
