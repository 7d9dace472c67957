from trackfield.types import Matrix, Vector

def step(
    shares: Matrix,
    mean: Matrix,
    covariance: Matrix,
    dt: float,
    motions: Matrix,
    kinds: Matrix,
    iteration: Vector,
    table: Matrix,
    value: Vector,
    alive: Vector,
) -> tuple[Matrix, Matrix, Matrix, Matrix, Matrix, Matrix, Matrix, Vector, Vector, Matrix]: ...
