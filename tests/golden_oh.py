"""Golden cases of many unknown targets over a lossy network, Oh: a function a kind."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from trackfield.network import channel

Case = dict[str, Any]
Answer = dict[str, Any]


def p_cs(given: Case) -> Answer:
    network = channel.Channel(p_loss=given["p_te"])
    return {"p_cs": channel.delivery_probability(network, given["k"])}


def delay_pmf(given: Case) -> Answer:
    return {"p": channel.delay_probability(given["p_de"], given["k"], given["d"])}


KINDS: dict[str, Callable[[Case], Answer]] = {
    "p_cs": p_cs,
    "delay_pmf": delay_pmf,
}
