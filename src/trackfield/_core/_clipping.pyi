import numpy as np
from numpy.typing import NDArray

from trackfield.types import Matrix

def clear(
    a: Matrix, b: Matrix, normals: Matrix, limits: Matrix, least: float, out: NDArray[np.uint8]
) -> None: ...
