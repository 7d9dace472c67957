"""Cost of energy: closed forms against quadrature, additivity, what is refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from trackfield.errors import InputError
from trackfield.scheduling.cost import custom, energy_cost, exponential, inverse, linear, power

PRICES = {
    "inverse": (inverse(), lambda t: 1.0 / t),
    "linear": (linear(9.0), lambda t: 9.0 - t),
    "exponential": (exponential(2.0), lambda t: np.exp(-t / 2.0)),
    "power": (power(2.5), lambda t: t**-2.5),
    "root": (power(0.5), lambda t: t**-0.5),
    "one": (power(1.0), lambda t: 1.0 / t),
}


@pytest.mark.parametrize("name", PRICES)
def test_a_closed_form_is_the_integral_of_its_price(name):
    price, p = PRICES[name]
    x, s = np.array([8.0, 3.0, 1.5]), np.array([1.0, 2.5, 0.25])
    expected = [quad(p, a - b, a)[0] for a, b in zip(x, s, strict=True)]
    np.testing.assert_allclose(energy_cost(x, s, price=price), expected, rtol=1e-9)
    np.testing.assert_allclose(energy_cost(x, s, price=custom(p)), expected, rtol=1e-9)


@given(st.floats(0.5, 30.0), st.floats(0.01, 0.4), st.sampled_from(sorted(PRICES)), st.booleans())
def test_spending_in_two_steps_costs_as_much_as_in_one(x, part, name, use_custom):
    price, p = PRICES[name]
    x = min(x, 8.5)
    price = custom(p) if use_custom else price
    a, b = 0.5 * part * x, part * x
    once = energy_cost(np.array([x]), a + b, price=price)
    steps = energy_cost(np.array([x]), a, price=price) + energy_cost(
        np.array([x - a]), b, price=price
    )
    np.testing.assert_allclose(once, steps, rtol=1e-7)


@pytest.mark.parametrize("name", PRICES)
def test_the_less_is_left_the_dearer(name):
    cost = energy_cost(np.linspace(1.0, 8.0, 30), 1.0, price=PRICES[name][0])
    assert (np.diff(cost) < 0.0).all()
    assert (cost > 0.0).all()


def test_more_than_there_is_cannot_be_spent_and_nothing_costs_nothing():
    x = np.array([0.0, 0.5, 1.0, 2.0])
    np.testing.assert_array_equal(energy_cost(x, 1.0, price=inverse())[:3], np.inf)
    assert np.isfinite(energy_cost(x, 1.0, price=power(0.5))[2])
    np.testing.assert_array_equal(energy_cost(x, 0.0, price=inverse()), 0.0)
    mixed = energy_cost(x, np.array([0.0, 0.0, 0.0, 1.0]), price=inverse())
    np.testing.assert_allclose(mixed, [0.0, 0.0, 0.0, np.log(2.0)])
    assert energy_cost(np.zeros(0), 1.0, price=inverse()).shape == (0,)


def test_the_last_energy_of_an_own_price_is_infinite_if_its_integral_diverges():
    x = np.array([1.0, 2.0])
    steep = energy_cost(x, 1.0, price=custom(lambda t: t**-2.0))
    np.testing.assert_allclose(steep, [np.inf, 0.5])
    mild = energy_cost(x, 1.0, price=custom(lambda t: 1.0 / np.sqrt(t)))
    np.testing.assert_allclose(mild, [2.0, 2.0 * (np.sqrt(2.0) - 1.0)], rtol=1e-6)


@pytest.mark.parametrize(
    ("x", "s", "price", "message"),
    [
        ([-1.0], 1.0, inverse(), "residual: found an energy of -1.0"),
        ([np.nan], 1.0, inverse(), "residual"),
        ([2.0], -0.5, inverse(), "spent: found an energy of -0.5"),
        ([2.0], 1.0, custom(lambda t: t), "rises"),
        ([2.0], 1.0, custom(lambda t: -t), "positive"),
        ([20.0], 1.0, linear(9.0), "positive"),
        ([2.0], 1.0, custom(lambda _: np.ones(3)), "shape"),
        ([2.0], 0.5, custom(lambda t: 1e3 - 1e2 * t + np.abs(t - 1.7) ** -1.5), "price"),
    ],
)
def test_what_is_no_energy_or_no_price_is_refused(x, s, price, message):
    with pytest.raises(InputError, match=message):
        energy_cost(np.array(x), s, price=price)


@pytest.mark.parametrize("make", [linear, exponential, power])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_parameters_of_prices_are_positive(make, value):
    with pytest.raises(InputError, match="positive"):
        make(value)
