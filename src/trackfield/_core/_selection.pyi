from trackfield.types import Indices, Matrix, Vector

def enumerated(
    gains: Matrix, priors: Matrix, weights: Vector, k: int, criterion: int, ridge: float, /
) -> Indices: ...
def exchanged(
    gains: Matrix, priors: Matrix, weights: Vector, k: int, criterion: int, ridge: float, /
) -> Indices: ...
