from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from trackfield.types import Indices, Matrix

class State:
    def __init__(self) -> None: ...
    def told(self) -> dict[str, float]: ...
    def scans(self) -> int: ...

class Names:
    def __init__(self) -> None: ...

class Model:
    def __init__(self, settings: Mapping[str, object]) -> None: ...
    def step(
        self,
        state: State,
        t: float,
        position: Matrix,
        covariance: Matrix,
        number: Indices,
        age: int,
        share: float,
    ) -> State: ...
    def estimates(
        self, state: State, names: Names, lag: int
    ) -> tuple[float, Matrix, NDArray[np.int32]]: ...
    def renamed(self, state: State, names: Names, replayed: int) -> Names: ...
    def check(self, state: State) -> None: ...

def take_in(
    position: Matrix,
    covariance: Matrix,
    number: Indices,
    region: Sequence[float],
    variance: float,
    known: Matrix,
) -> tuple[int, NDArray[np.uint8], int, int]: ...
def explain(
    state: State, names: Names, track: int
) -> tuple[float, float, list[tuple[float, list[int]]]] | None: ...
def encode(states: Sequence[State], names: Names) -> bytes: ...
def decode(data: bytes) -> tuple[list[State], Names]: ...
