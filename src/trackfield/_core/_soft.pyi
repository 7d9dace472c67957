from trackfield.types import Indices, Matrix, Vector

def cheapest(
    priors: Matrix,
    gains: Matrix,
    prices: Matrix,
    bounds: Vector,
    worths: Vector,
    fewest: int,
    most: int,
    /,
) -> tuple[Indices, Vector, Vector]: ...
