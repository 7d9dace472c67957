"""What all tests share: one thread a process, repeatable draws, and the recorded data."""

from __future__ import annotations

import os

# Before anything imports NumPy: workers use all cores already, and sums must not depend on them.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import signal
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

ROOT = Path(__file__).parents[1]
IN_CI = os.environ.get("CI", "").lower() in {"1", "true"}

# A shell that starts the tests in the background has them ignore the interrupt key, and whatever
# they start; a test that interrupts the program needs the usual behaviour.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# No deadline: a loaded machine is not a fault of the code.
patient = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("local", patient)
settings.register_profile("ci", patient, derandomize=True, print_blob=True)
settings.load_profile("ci" if IN_CI else "local")


def lacking(what: str) -> None:
    """Skip the test with one line that says what is missing; in CI, fail."""
    if IN_CI:
        pytest.fail(f"missing in CI: {what}", pytrace=False)
    pytest.skip(f"missing: {what}")


@pytest.fixture(scope="session")
def root() -> Path:
    """The checkout."""
    return ROOT


@pytest.fixture(scope="session")
def shared() -> Path:
    """Recorded data and golden cases beside the checkout; read only."""
    path = ROOT.parent / "shared"
    if not path.is_dir():
        lacking("the folder ../shared beside the checkout (recorded data)")
    return path
