from trackfield.types import Indices, Matrix, Vector

def left(
    gains: Matrix, priors: Matrix, rows: Indices, criterion: int, /
) -> tuple[Matrix, Matrix, float]: ...
def enumerated(
    gains: Matrix, priors: Matrix, weights: Vector, k: int, criterion: int, ridge: float, /
) -> Indices: ...
def exchanged(
    gains: Matrix, priors: Matrix, weights: Vector, k: int, criterion: int, ridge: float, /
) -> Indices: ...
def searched(
    gains: Matrix, priors: Matrix, k: int, criterion: int, ridge: float, work: int, /
) -> tuple[Indices, float, Matrix, bool]: ...
def relaxed(
    gains: Matrix, priors: Matrix, k: int, criterion: int, ridge: float, tolerance: float, /
) -> tuple[Vector, float, float, Matrix]: ...
def affordable(
    gains: Matrix,
    priors: Matrix,
    k: int,
    criterion: int,
    ridge: float,
    costs: Vector,
    budget: float,
    work: int,
    /,
) -> tuple[Indices, float, bool]: ...
def sufficient(
    gains: Matrix,
    priors: Matrix,
    k: int,
    criterion: int,
    ridge: float,
    costs: Vector,
    level: float,
    able: Indices,
    work: int,
    /,
) -> tuple[Indices, float, bool]: ...
