from collections.abc import Mapping

from trackfield.types import Indices, Matrix, Vector

def locate(
    places: Matrix,
    z: Vector,
    columns: list[Vector],
    factor_sigma: float,
    strongest_only: bool,
    settings: Mapping[str, float],
    /,
) -> tuple[Matrix, Indices, Indices, bool]: ...
