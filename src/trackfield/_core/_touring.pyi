from trackfield.types import Matrix, Vector

def tour(
    start: Vector, centres: Matrix, radii: Vector, gap: float, most: int
) -> tuple[Matrix, float, float, int, bool]: ...
