from trackfield.types import Matrix, Vector

def fit(
    times: Matrix,
    values: Matrix,
    columns: list[Vector],
    limits: Matrix,
    rayleigh: bool,
    searched: bool,
    out: Matrix,
) -> None: ...
