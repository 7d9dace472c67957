"""What it costs to take energy from a node that has little left, Pham (5.1), corrected."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, cast

import numpy as np
from scipy.integrate import quad  # pyright: ignore[reportUnknownVariableType]  it has no types

from trackfield.errors import InputError
from trackfield.types import Vector

Curve = Callable[[Vector], Vector]
_SAMPLES = 33  # at which a price must be seen to fall


class Price(NamedTuple):
    """Price p(t) of the unit of energy at residual energy t > 0: positive, falling as t rises.

    `integral` is one of its antiderivatives, at t >= 0, where it may be -inf; None where there is
    no closed form, and the cost is found by quadrature.
    """

    at: Curve
    integral: Curve | None = None


def inverse() -> Price:
    """p(t) = 1/t: the cost is the logarithm of x / (x - s), infinite for the last of the energy."""

    def at(t: Vector) -> Vector:
        return 1.0 / t

    def integral(t: Vector) -> Vector:
        with np.errstate(divide="ignore"):
            return np.log(t)

    return Price(at, integral)


def linear(capacity: float) -> Price:
    """p(t) = c - t, of nodes whose full energy is less than c = `capacity`."""
    if not (np.isfinite(capacity) and capacity > 0.0):
        raise InputError(f"capacity: found {capacity}, expected a positive number")

    def at(t: Vector) -> Vector:
        return capacity - t

    def integral(t: Vector) -> Vector:
        return capacity * t - 0.5 * t**2

    return Price(at, integral)


def exponential(scale: float = 1.0) -> Price:
    """p(t) = exp(-t / scale)."""
    if not (np.isfinite(scale) and scale > 0.0):
        raise InputError(f"scale: found {scale}, expected a positive number")

    def at(t: Vector) -> Vector:
        return np.exp(-t / scale)

    def integral(t: Vector) -> Vector:
        return -scale * np.exp(-t / scale)

    return Price(at, integral)


def power(exponent: float) -> Price:
    """p(t) = t^-a, a > 0; a = 1 is `inverse`."""
    if not (np.isfinite(exponent) and exponent > 0.0):
        raise InputError(f"exponent: found {exponent}, expected a positive number")
    if exponent == 1.0:
        return inverse()
    rise = 1.0 - exponent

    def at(t: Vector) -> Vector:
        return t**-exponent

    def integral(t: Vector) -> Vector:
        with np.errstate(divide="ignore"):
            return t**rise / rise

    return Price(at, integral)


def custom(price: Curve) -> Price:
    """Take any continuous, positive and decreasing p(t), by quadrature."""
    return Price(price)


def energy_cost(residual: Vector, spent: Vector | float, *, price: Price) -> Vector:
    """Cost c_i = integral of p from x_i - s_i to x_i, (n,); infinite where x_i < s_i.

    `residual` x (n,) and `spent` s (n,) or one number, in one unit of energy. `InputError` for
    energies that are negative or no numbers, and for a price that is not positive and falling over
    the residual energies. Pham (5.1), corrected.
    """
    x = _energies(residual, "residual")
    s = np.broadcast_to(_energies(spent, "spent"), x.shape)
    cost = np.where(x < s, np.inf, 0.0)
    paid = (s > 0.0) & (x >= s)
    if paid.any():
        high, low = x[paid], x[paid] - s[paid]
        _check_price(price, float(high.max()))
        if price.integral is not None:
            cost[paid] = price.integral(high) - price.integral(low)
        else:
            cost[paid] = _quadrature(price.at, low, high)
    return cost


def _energies(values: Vector | float, what: str) -> Vector:
    energies = np.asarray(values, np.float64)
    wrong = energies[~(np.isfinite(energies) & (energies >= 0.0))]
    if wrong.size:
        raise InputError(f"{what}: found an energy of {wrong[0]}, expected 0 or more")
    return energies


def _check_price(price: Price, most: float) -> None:
    """Refuse a price that rises, or is not positive, at energies in (0, most]."""
    at = most * np.arange(1, _SAMPLES + 1) / _SAMPLES
    p = np.asarray(price.at(at), np.float64)
    if p.shape != at.shape:
        raise InputError(f"price: found values of shape {p.shape} for energies of {at.shape}")
    if not (np.isfinite(p).all() and (p >= 0.0).all() and (p[:-1] > 0.0).all()):
        raise InputError(f"price: found {p.min()}, expected positive numbers up to {most:g}")
    rising = np.flatnonzero(np.diff(p) > 1e-12 * p[0])
    if rising.size:
        raise InputError(f"price: it rises at {at[rising[0]]:g}, expected one that falls")


def _quadrature(price: Curve, low: Vector, high: Vector) -> Vector:
    """Integrals (n,), each pair of limits once; infinite where they diverge at no energy left."""
    pairs, place = np.unique(np.stack([low, high]), axis=1, return_inverse=True)
    found = np.array([_integral(price, a, b) for a, b in pairs.T])
    return found[place.reshape(-1)].reshape(low.shape)


def _integral(price: Curve, low: float, high: float) -> float:
    """Integral over one interval, in which a falling price can diverge at 0 only."""

    def at(t: float) -> float:
        return float(price(np.array(t)))

    with np.errstate(divide="ignore", over="ignore"):
        found = cast("tuple[Any, ...]", quad(at, low, high, full_output=1))
    value, message = float(found[0]), found[3:]  # a message where it did not converge
    if message or not np.isfinite(value):
        if low > 0.0:
            raise InputError(f"price: no integral from {low:g} to {high:g}, expected a smooth one")
        return np.inf
    return value
