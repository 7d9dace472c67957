from trackfield.types import Matrix, Vector

def modes(
    sensors: Matrix,
    numbers: Matrix,
    records: Matrix,
    fishers: Matrix,
    roundings: Matrix,
    exponent: float,
    exponent_sigma: float,
    pairs_of: int,
    searched: int,
    /,
) -> tuple[Matrix, Matrix, Matrix, Matrix, Matrix, Vector, float]: ...
