"""What tracking needs of a site: how many sensors of a kind, and where they must stand."""

from __future__ import annotations

from typing import NamedTuple

from trackfield.network.geometry import FLAT, geometry, thinness
from trackfield.network.kinds import Family, families, kind_of
from trackfield.network.site import Site
from trackfield.sensing.amplitude import AmplitudeModel
from trackfield.sensing.energy_message import EnergyMessageModel

_UNTOLD = AmplitudeModel().sigma
_ALONE = "a single one tells no place"
_FOREVER = "a path and its mirror image about the line look the same for ever"
_MIRRORED: dict[Family, str] = {  # what a line of sensors does not tell
    "angle": "a target and its mirror image about the line, going back, look the same for a while",
    "rssi": "a beacon and its mirror image about the line sound the same",
    "amplitude": "a trajectory and its mirror image about the line sound the same: both are told",
    "energy_message": (
        "a trajectory and its mirror image about the line sound the same: both are told"
    ),
}


class Needs(NamedTuple):
    """What makes positions impossible or ambiguous: everywhere (`problems`), or often."""

    problems: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()


def needs(site: Site, sensors: tuple[str, ...] | None = None) -> Needs:
    """Judge all sensors of a site, or those named, by what they measure.

    Sites of several families, and of kinds that tell of unknown targets, are not judged: who knows
    which of them speaks.
    """
    present = families(site.models)
    if len(present) != 1:
        return Needs()
    (family,) = present
    if family == "range":
        places = geometry(site, sensors)
        return Needs(places.problems, places.remarks)
    ids = site.sensor_ids if sensors is None else sensors
    own = [i for i, name in enumerate(site.sensor_ids) if name in set(ids)]
    some = ", ".join(ids[:8]) + (", ..." if len(ids) > 8 else "") or "none"
    found = f"found {len(ids)} sensors ({some})"
    if family == "angle":
        kinds = {kind_of(site.models[i]) for i in own}
        flat = len(own) > 2 and thinness(site.positions[own, :2]) < FLAT
        return _of_angles(found, len(own), kinds, flat=flat)
    if family not in _MIRRORED:
        return Needs()
    if family != "rssi" and len(own) < 3:
        return Needs((f"{found}, expected at least 3, not in a line: fewer tell no trajectory",))
    if len(own) < 2:
        return Needs((f"{found}, expected at least 2, and better 3: {_ALONE}",))
    remarks = _of_noise(site)
    if len(own) == 2 or thinness(site.positions[own, :2]) < FLAT:
        remarks = (f"{found}, all on one line: {_MIRRORED[family]}", *remarks)
    return Needs(remarks=remarks)


def _of_noise(site: Site) -> tuple[str, ...]:
    """Say that the noise of amplitudes is not told: it has their unit, which nobody else knows."""
    told = [
        one.sigma for one in site.models if isinstance(one, AmplitudeModel | EnergyMessageModel)
    ]
    if _UNTOLD not in told:
        return ()
    return (f"sigma = {_UNTOLD:g} is the default: what is the noise, in the unit of amplitudes?",)


def _of_angles(found: str, count: int, kinds: set[str], *, flat: bool) -> Needs:
    """Judge sensors that tell directions, how fast they turn, or motion across them.

    `flat`: they stand on a line.
    """
    if count < 2:
        return Needs((f"{found}, expected at least 2: {_ALONE}",))
    if "bearing" not in kinds and count < 3:
        expected = "at least 3 of angular_rate and motion, or a bearing among them"
        return Needs((f"{found}, expected {expected}",))
    remarks = ()
    if "bearing" not in kinds and flat:
        same = _FOREVER if kinds == {"motion"} else _MIRRORED["angle"]
        remarks = (f"{found}, all on one line: {same}",)
    if kinds == {"motion"} and count < 5:
        return Needs(
            remarks=(
                *remarks,
                f"{found}, which leave several answers at first: motion sensors do not tell which "
                "way a target goes, and fewer than 5 not where it is until it has moved on "
                "straight: one that turns may be told in a wrong place",
            )
        )
    return Needs(remarks=remarks)
