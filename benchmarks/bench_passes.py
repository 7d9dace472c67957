"""Fusion of energy messages: errors against the Cramer-Rao bound, and time of a trajectory.

    python benchmarks/bench_passes.py [RUNS] [SEED]

The layout is that of the tests (km, s); "random" are four sensors drawn in the same field and a
straight pass through it, every closest approach within the record. An outlier is an error of x0
above five times its bound. The likeliest trajectory counts, "nearest" is the best of those that
came back; "raw" is maximum likelihood on all samples, from the truth, its outliers left out.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from trackfield.localization import pass_raw
from trackfield.localization.pass_bounds import pass_bound
from trackfield.localization.pass_fusion import (
    Passes,
    PassSettings,
    PassVerdict,
    fuse,
    fuse_as_printed,
)
from trackfield.localization.pass_messages import PassMessages, common_records, fishers
from trackfield.sensing import amplitude, profile_fit
from trackfield.sensing.amplitude import AmplitudeModel, Fading
from trackfield.types import Matrix, Vector

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from pass_scene import LAYOUT, PASS

HZ, LAST_S = 1.0, 24.0
WIDTHS = profile_fit.LIMITS


class Case:
    """Sensors, a pass, and what was heard of it in one run."""

    def __init__(
        self,
        rng: np.random.Generator,
        sensors: Matrix,
        theta: Vector,
        model: AmplitudeModel,
        hz: float = HZ,
    ) -> None:
        self.sensors, self.theta, self.model = sensors, theta, model
        self.t_s = np.arange(0.0, LAST_S + 0.5 / hz, 1.0 / hz)
        path = theta[1:3] + self.t_s[:, None] * theta[3:]
        self.values = amplitude.simulate(
            model, sensors, path=path, power=theta[0], rng=rng
        ).value.T.copy()
        fitted = profile_fit.fit(model, self.t_s, self.values, limits=WIDTHS)
        n = len(sensors)
        records = common_records(n, self.t_s)
        self.messages = PassMessages(sensors, (model,) * n, fitted.profile.array(), records)

    def bound(self) -> float:
        """Least standard deviation of x0."""
        found = pass_bound(self.theta, self.sensors, self.t_s, models=self.model)
        return float(np.sqrt(found.covariance[1, 1] + found.covariance[2, 2]))

    def raw(self) -> float:
        """Error of x0 of maximum likelihood on all samples."""
        n, m = self.values.shape
        given = pass_raw.RawPass(
            self.sensors,
            self.messages.models,
            np.repeat(np.arange(n, dtype=np.int32), m),
            np.tile(self.t_s, n),
            self.values.ravel(),
        )
        found = pass_raw.fits(given, self.theta[None])[0]
        return float(np.linalg.norm(found.theta[1:3] - self.theta[1:3]))


def layout(
    rng: np.random.Generator, n: int, snr_db: float, fading: Fading = "none", hz: float = HZ
) -> Case:
    """Draw a run in the layout; the ratio is P / sigma^2 at 1 km."""
    return Case(
        rng, LAYOUT[:n], PASS, AmplitudeModel(sigma=10 ** (-snr_db / 20), fading=fading), hz
    )


def random(rng: np.random.Generator, n: int, snr_db: float) -> Case:
    """Draw sensors in the field and a pass through it that all of them see come and go."""
    while True:
        sensors = rng.uniform(-2.0, 2.0, (n, 2))
        heading, aside = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(-1.0, 1.0)
        u = np.array([np.cos(heading), np.sin(heading)])
        middle = aside * np.array([-u[1], u[0]])
        t_max = LAST_S / 2 + (sensors - middle) @ u / 0.2
        if (t_max >= 0.0).all() and (t_max <= LAST_S).all():
            break
    x0 = middle - 0.2 * u * LAST_S / 2
    model = AmplitudeModel(sigma=10 ** (-snr_db / 20))
    return Case(rng, sensors, np.array([1.0, *x0, *(0.2 * u)]), model)


def anything(rng: np.random.Generator) -> Case:
    """Draw a pass of any kind: sensors, speed, side, exponent, noise, fading, before or after."""
    n, heading = int(rng.integers(3, 13)), rng.uniform(0.0, 2.0 * np.pi)
    u, speed = np.array([np.cos(heading), np.sin(heading)]), np.exp(rng.uniform(-3.0, -0.5))
    x0 = rng.uniform(-2.5, 2.5) * np.array([-u[1], u[0]]) - rng.uniform(4.0, 20.0) * speed * u
    model = AmplitudeModel(
        exponent=float(rng.choice([1.0, 1.5, 2.0])),
        sigma=10 ** (-rng.uniform(0.0, 35.0) / 20),
        fading="rayleigh" if rng.random() < 0.25 else "none",
    )
    hz = 1.0 if model.fading == "none" else 2.0
    return Case(rng, rng.uniform(-2.0, 2.0, (n, 2)), np.array([1.0, *x0, *(speed * u)]), model, hz)


def row(
    name: str,
    draw: Callable[[], Case],
    runs: int,
    *,
    fused: Callable[[PassMessages], Passes] = fuse,
) -> None:
    """Print a line of the table."""
    best, nearest, central, weight, count, good = np.zeros((6, runs))
    for i in range(runs):
        case = draw()
        found, sd = fused(case.messages), case.bound()
        if not len(found.theta):  # no more than noise: no answer, and none that is wrong
            continue
        errors = np.linalg.norm(found.theta[:, 1:3] - case.theta[1:3], axis=1) / sd
        best[i], nearest[i], central[i] = errors[0], errors.min(), case.raw() / sd
        weight[i], count[i] = found.weight[errors <= 5.0].sum(), len(errors)
        good[i] = found.verdict == PassVerdict.GOOD
    out = best > 5.0
    raw = rms(central[central <= 5.0])
    print(
        f"{name:24s} | {out.mean():6.1%} | {rms(best[~out]):5.3f} | {rms(best):6.3f} | {raw:5.3f}"
        f" | {(best <= 4.0).mean():6.1%} | {(nearest > 5.0).mean():5.1%} | {count.mean():4.2f}"
        f" | {weight.mean():.3f} | {good.mean():6.1%} | {(out & (good > 0)).mean():.2%}",
        flush=True,
    )


def rms(x: Vector) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(x)))) if x.size else 0.0


def times(rng: np.random.Generator, n: int) -> None:
    """Print processor time of a trajectory of `n` sensors."""
    cases = [layout(rng, n, 10.0).messages for _ in range(20)]
    for name in ("loudest", "all"):
        settings = PassSettings(starts=name)
        best = np.inf
        for _ in range(15):
            t0 = time.process_time()
            for messages in cases:
                fuse(messages, settings=settings)
            best = min(best, (time.process_time() - t0) / len(cases))
        print(f"K = {n:2d} {name:7s} starts {1e3 * best:.3f} ms")


def main() -> None:
    """Print the tables."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    rng = np.random.default_rng(int(sys.argv[2]) if len(sys.argv) > 2 else 0)
    for n in (20, 5, 3):
        times(rng, n)
    print(
        "case | outliers | RMSE/CRLB of the rest | of all | raw samples | within 4x "
        "| outliers of the nearest | trajectories | weight of the true one | good | good outliers"
    )
    for n, snr in ((20, 10), (10, 10), (5, 10), (3, 10), (20, 25), (5, 25), (3, 25), (3, 40)):
        row(f"K = {n}, {snr} dB", lambda n=n, snr=snr: layout(rng, n, snr), runs)
    row("random, K = 4, 20 dB", lambda: random(rng, 4, 20.0), runs)
    row("anything", lambda: anything(rng), runs)
    for hz, n, snr in ((10.0, 5, 20), (2.0, 10, 20), (2.0, 10, 40)):
        row(
            f"fading, {hz:g} Hz, K = {n}, {snr} dB",
            lambda n=n, snr=snr, hz=hz: layout(rng, n, snr, "rayleigh", hz),
            runs // 2,
        )
    for n in (20, 10, 5, 3):
        row(
            f"paper mode, K = {n}, 10 dB",
            lambda n=n: layout(rng, n, 10.0),
            runs // 2,
            fused=lambda m: fuse_as_printed(m, fishers(m)),
        )


if __name__ == "__main__":
    main()
