from trackfield.types import Indices, Matrix, Vector

def cheapest(
    offsets: Indices,
    nodes: Indices,
    gains: Matrix,
    prices: Vector,
    prior: Matrix,
    bound: float,
    k: int,
) -> tuple[Indices, Vector]: ...
def sharpest(
    offsets: Indices,
    nodes: Indices,
    gains: Matrix,
    prices: Vector,
    prior: Matrix,
    k: int,
) -> tuple[Indices, Vector]: ...
def shares(
    offsets: Indices,
    nodes: Indices,
    gains: Matrix,
    prices: Vector,
    prior: Matrix,
    bound: float,
    k: int,
) -> tuple[Vector, Vector]: ...
def balance(
    offsets: Indices,
    nodes: Indices,
    gains: Matrix,
    capacity: Vector,
    prior: Matrix,
    bound: float,
    k: int,
    exponent: float,
    sweeps: int,
) -> Indices: ...
