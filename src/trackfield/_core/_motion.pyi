from trackfield.types import Indices, Matrix, Vector

def descend(
    t: Vector,
    sensor: Matrix,
    drift: Matrix,
    columns: Matrix,
    kind: Indices,
    starts: Matrix,
    centre: Vector,
    reach: float,
    iterations: int,
    /,
) -> Matrix: ...
def costs(
    t: Vector,
    sensor: Matrix,
    drift: Matrix,
    columns: Matrix,
    kind: Indices,
    states: Matrix,
    /,
) -> Matrix: ...
