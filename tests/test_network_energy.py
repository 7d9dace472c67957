"""Powers of modes and of a field: by hand and by Pham's table; what cannot be is refused."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trackfield.errors import ConfigurationError, InputError
from trackfield.network.energy import (
    Energy,
    message_energy,
    mode_energies,
    mode_powers,
    network_power,
)
from trackfield.network.site_file import site_from_toml
from trackfield.network.site_writer import site_text
from trackfield.types import Mode

SENSORS = "[[sensors]]\nsensor_id = 'A'\nx_m = 0\ny_m = 0\n"
counts = st.integers(0, 50)
powers = st.floats(0.0, 1e4)


@given(tx=powers, rx=powers, n=counts)
def test_powers_of_modes_are_sums_of_what_a_node_does(tx, rx, n):
    energy = Energy(tx, rx, 830.0, 130.0, sense_mw=7.0, compute_mw=11.0)
    found = mode_powers(energy, n)
    assert found[Mode.SLEEPING] == 130.0
    assert found[Mode.ACTIVE] == pytest.approx(rx + 830.0)
    assert found[Mode.SENSING] == pytest.approx(rx + 7.0 + tx + 830.0)
    assert found[Mode.MASTER] == pytest.approx(tx + n * rx + 11.0 + 830.0)
    np.testing.assert_allclose(mode_energies(energy, 0.25, sensing=n), found / 4000.0)
    np.testing.assert_array_equal(mode_powers(energy, [n, 3])[0], found)


@given(n_a=counts, n_i=counts, n_b=counts, c=powers)
def test_a_field_spends_what_its_nodes_spend_one_by_one(n_a, n_i, n_b, c):
    energy = Energy()
    said = [energy.tx_mw + energy.rx_mw] * n_a  # each sends, and the master hears each
    said += [energy.tx_mw] + [energy.rx_mw] * (n_a + n_i)  # all are told
    said += [energy.idle_mw] * (n_b + n_i) + [energy.sleep_mw] * (200 - n_a - n_i - n_b)
    roles = {"measuring": n_a, "warned": n_i, "watching": n_b}
    found = network_power(energy, 200, **roles, constant_mw=c)
    assert found == pytest.approx(math.fsum(said) + c)
    stacked = {role: np.array([count, 0]) for role, count in roles.items()}
    assert network_power(energy, 200, **stacked)[1] == 1400.0 + 200 * 130.0


def test_the_table_of_pham_needs_fifty_six_watts_more():
    """Table 2.1: printed counts give the printed powers to their last digit, or within .5 %."""
    n_a = np.array([4.5, 17.5, 60.4, 130.8, 279.1])
    active = np.array([9.3, 39.2, 139.9, 275.5, 416.2])
    printed = np.array([1.38e5, 2.09e5, 4.48e5, 7.88e5, 12.60e5])
    roles = {"measuring": n_a, "warned": active - n_a}
    np.testing.assert_allclose(
        network_power(Energy(), 441, **roles, constant_mw=56e3), printed, rtol=0.005
    )
    assert (network_power(Energy(), 441, **roles) < 0.96 * printed).all()


def test_messages_cost_bits_at_every_hop():
    energy = Energy(tx_uj_per_bit=2.0, rx_uj_per_bit=1.0, hop_uj=10.0)
    np.testing.assert_allclose(message_energy(energy, 100, [0, 1, 3]), [0.0, 310e-6, 930e-6])
    with pytest.raises(InputError, match="bits or hops below 0"):
        message_energy(energy, -1, 1)


@pytest.mark.parametrize("key", [field.name for field in dataclasses.fields(Energy)])
def test_nothing_spends_less_than_nothing(key):
    with pytest.raises(InputError, match=rf"energy.{key}: found -1, expected a finite number"):
        Energy(**{key: -1})
    with pytest.raises(InputError, match=f"energy.{key}: found nan"):
        Energy(**{key: math.nan})
    with pytest.raises(ConfigurationError) as caught:
        site_from_toml(f"[energy]\n{key} = -1\n{SENSORS}", Path(), "field.toml")
    (problem,) = caught.value.problems
    assert problem.startswith(f"field.toml: energy.{key}: found -1, expected a")


def test_what_is_refused_beside_powers():
    with pytest.raises(
        InputError, match=r"energy.battery_j: found 0.0, expected a finite .* above 0"
    ):
        Energy(battery_j=0.0)
    with pytest.raises(InputError, match=r"more than there are \(5\)"):
        network_power(Energy(), 5, measuring=4, warned=2)
    with pytest.raises(InputError, match="counts of nodes below 0"):
        network_power(Energy(), 5, measuring=-1, warned=2)
    with pytest.raises(InputError, match=r"found -1.0 sensing nodes"):
        mode_powers(Energy(), -1)


def test_a_site_says_what_nodes_spend_or_gets_the_usual():
    assert site_from_toml(SENSORS, Path()).energy == Energy()
    site = site_from_toml(f"[energy]\ntx_mw = 60\nreading_bits = 64\n{SENSORS}", Path(), "a.toml")
    assert site.energy == Energy(tx_mw=60.0, reading_bits=64)
    again = site_from_toml(site_text(site, Path()), Path(), "a.toml")
    assert again.energy == site.energy
    assert "[energy]" not in site_text(site_from_toml(SENSORS, Path()), Path())
