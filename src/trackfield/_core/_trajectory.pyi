import numpy as np
from numpy.typing import NDArray

from trackfield.types import Indices, Matrix, Vector

def fit(
    starts: Matrix,
    sensors: Matrix,
    bounds: NDArray[np.int64],
    t_s: Vector,
    values: Vector,
    free_exponent: bool,
    most: int,
    done: float,
    /,
) -> tuple[Matrix, Matrix, Matrix, Matrix, Indices, NDArray[np.bool_]]: ...
