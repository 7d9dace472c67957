"""Profiles of passes: time of a fit against SciPy, how often each finds the likeliest, messages.

    python benchmarks/bench_profiles.py [RUNS] [SEED]

Records of 25 samples, passes anywhere in them: largest amplitude 0.5 to 2, half a sample to 15
wide. SciPy fits from the same first start (the paper's), by least squares without fading and by
L-BFGS-B with it. Times are processor time, the least over repeats, both sides in turn.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np
from scipy import optimize

from trackfield.experiments.berger_local import coarse
from trackfield.sensing import amplitude, profile
from trackfield.sensing.amplitude import AmplitudeModel, Fading
from trackfield.sensing.energy_message import EnergyMessageModel, decode, encode
from trackfield.sensing.profile import Profile
from trackfield.sensing.profile_fit import fit
from trackfield.types import Matrix, Vector

T = np.arange(25.0)
PEERS = 100  # records that SciPy fits
FADINGS: tuple[Fading, ...] = ("none", "rayleigh")


def records(rng: np.random.Generator, model: AmplitudeModel, runs: int) -> Matrix:
    """Draw samples (runs, 25)."""
    at = Profile(
        rng.uniform(0.5, 2.0, runs), rng.uniform(0.0, 24.0, runs), rng.uniform(0.5, 15.0, runs)
    )
    return amplitude.noisy(model, profile.expected(at, T), rng=rng)


def by_scipy(model: AmplitudeModel, values: Matrix) -> Vector:
    """Negative log-likelihood (runs,) at which SciPy ends."""
    low, high = np.array([1e-4, -2.4, 0.02]), np.array([200.0, 26.4, 36.0])
    starts = np.clip(coarse(T, values).array(), low, high)
    costs = np.empty(len(values))
    for i, (z, start) in enumerate(zip(values, starts, strict=True)):

        def cost(x: Vector, z: Vector = z) -> float:
            at = profile.profile_of(x)
            return float(profile.negative_log_likelihood(at, T, z, models=model))

        def residuals(x: Vector, z: Vector = z) -> Vector:
            return (profile.expected(profile.profile_of(x), T) - z) / model.sigma

        if model.fading == "none":
            x = optimize.least_squares(residuals, start, bounds=(low, high)).x
        else:
            x = optimize.minimize(cost, start, bounds=list(zip(low, high, strict=True))).x
        costs[i] = cost(x)
    return costs


def least_time(call: Callable[[], object], repeats: int = 5) -> float:
    """Processor time of a call [s]."""
    times: list[float] = []
    for _ in range(repeats):
        start = time.process_time()
        call()
        times.append(time.process_time() - start)
    return min(times)


def main() -> None:
    """Print a line a kind of noise."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
    rng = np.random.default_rng(int(sys.argv[2]) if len(sys.argv) > 2 else 90_000)
    for fading in FADINGS:
        for sigma in (0.5, 0.2, 0.05):
            model = AmplitudeModel(sigma=sigma, fading=fading)
            values = records(rng, model, runs)
            ours = least_time(lambda m=model, z=values: fit(m, T, z)) / runs
            some = values[:PEERS]
            theirs = least_time(lambda m=model, z=some: by_scipy(m, z), 1) / PEERS
            lost = by_scipy(model, some) + fit(model, T, some).log_likelihood
            print(
                f"{fading:8} sigma {sigma:4}: {1e6 * ours:5.1f} us a fit, "
                f"SciPy {theirs / ours:5.0f} times as long; "
                f"ends half a nat lower: SciPy {100 * np.mean(lost > 0.5):4.1f} %, "
                f"ours {100 * np.mean(lost < -0.5):4.1f} %"
            )
    sender = EnergyMessageModel(sigma=0.1, record_s=24.0)
    found = fit(AmplitudeModel(), T, records(rng, AmplitudeModel(), runs)).profile
    word = encode(sender, found, end_s=24.0)
    there = least_time(lambda: encode(sender, found, end_s=24.0)) / runs
    back = least_time(lambda: decode(sender, word, end_s=24.0)) / runs
    print(f"messages: encoded in {1e6 * there:.2f} us, decoded in {1e6 * back:.2f} us each")


if __name__ == "__main__":
    main()
