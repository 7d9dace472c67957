"""Binary detections: a sensor says 1 where something moves in its region, Oh III.A."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class DetectionModel:
    """P(z = 1) is `p_detection` with a target inside the sensing region, `p_false` without.

    Several targets inside are seen independently: 1 - (1 - p_detection)^n. The region is a disc of
    `radius_m`, a sector of it (`width_deg` about `heading_deg`, counter-clockwise from east), or a
    `polygon` of corners (x, y) [m] relative to the sensor. Across the border the probability falls
    over about `edge_m`.
    """

    radius_m: float = 7.62
    p_detection: float = 0.7
    p_false: float = 0.05
    edge_m: float = 0.0
    heading_deg: float = 0.0
    width_deg: float = 360.0
    polygon: tuple[tuple[float, float], ...] = ()
