"""The nouns that pass through the flow: readings, reports, tracks, truth; all immutable.

Tables (`Readings`, `Truth`, `Tracks`) hold columns, not rows, because a run has millions of rows.
Sensors and targets are written as integers that index the table's own tuple of names.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from enum import IntEnum
from types import ModuleType
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Indices = NDArray[np.int32]
ArrowTable = Any  # pyarrow.Table, which has no types
DataFrame = Any  # pandas.DataFrame, which need not be there


class Names(NamedTuple):
    """A column of names: `places` (n,) in `names`, -1 where there is none."""

    places: Indices
    names: tuple[str, ...]


Columns = Mapping[str, NDArray[Any] | Names]  # of a table, called as in its file
Arrays = dict[str, NDArray[Any]]


def arrays(columns: Columns) -> Arrays:
    """Make arrays of columns: names as text, None where there is none; numbers are not copied."""
    return {
        name: np.array([*column.names, None], dtype=object)[column.places]  # -1 is the last one
        if isinstance(column, Names)
        else column
        for name, column in columns.items()
    }


def arrow_table(columns: Columns) -> ArrowTable:
    """Make a table of Arrow: NaN and no name are null, names are dictionary-encoded."""
    arrow = _optional("pyarrow")
    return arrow.table({name: _arrow_array(arrow, column) for name, column in columns.items()})


def data_frame(columns: Columns) -> DataFrame:
    """Make a data frame of pandas: names are categories, in the order of their table."""
    pandas = _optional("pandas")
    return pandas.DataFrame(
        {
            name: pandas.Categorical.from_codes(column.places, list(column.names))
            if isinstance(column, Names)
            else column
            for name, column in columns.items()
        }
    )


class Gaussian(NamedTuple):
    """A belief N(mean, covariance); mean (n,), covariance (n, n), SI units."""

    mean: Vector
    covariance: Matrix


class Reading(NamedTuple):
    """What one sensor said at one time; one row of `Readings`."""

    t_s: float
    sensor_id: str
    kind: str
    value: float
    sigma: float | None = None
    target_id: str | None = None
    arrival_s: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """Readings as columns, in order of arrival; all arrays have shape (n,).

    `sensor`, `kind`, `target` index the tuples `sensor_ids`, `kinds`, `target_ids`; a target of -1
    is a reading that names none. `sigma` is NaN where the sensor gave none, `arrival_s` is NaN
    where the reading is taken as it comes.
    """

    t_s: Vector
    sensor: Indices
    value: Vector
    target: Indices
    kind: Indices
    sigma: Vector
    arrival_s: Vector
    sensor_ids: tuple[str, ...]
    target_ids: tuple[str, ...]
    kinds: tuple[str, ...]

    def __len__(self) -> int:
        return int(self.t_s.size)

    def columns(self) -> Columns:
        """Columns as in a file; views, not copies."""
        return {
            "t_s": self.t_s,
            "sensor_id": Names(self.sensor, self.sensor_ids),
            "kind": Names(self.kind, self.kinds),
            "value": self.value,
            "sigma": self.sigma,
            "target_id": Names(self.target, self.target_ids),
            "arrival_s": self.arrival_s,
        }

    def to_numpy(self) -> Arrays:
        """Make arrays of `columns`: names as text, None where there is none."""
        return arrays(self.columns())

    def to_arrow(self) -> ArrowTable:
        """Make a `pyarrow.Table` of `columns`; `ImportError` without the extra `data`."""
        return arrow_table(self.columns())

    def to_pandas(self) -> DataFrame:
        """Make a `pandas.DataFrame` of `columns`; `ImportError` without the extra `data`."""
        return data_frame(self.columns())


@dataclass(frozen=True, slots=True, eq=False)
class Reports:
    """Positions that name no target, in order of arrival: one row a report.

    `position` (n, 3) [m], z NaN where unknown; `covariance` (n, 3) holds xx, xy, yy [m^2], NaN
    where the report brings none; `confidence` (n,) is the probability that it is of a target, NaN
    where unknown; `arrival_s` is NaN where the report is taken as it comes.
    """

    t_s: Vector
    arrival_s: Vector
    position: Matrix
    covariance: Matrix
    confidence: Vector

    def __len__(self) -> int:
        return int(self.t_s.size)

    def columns(self) -> Columns:
        """Columns as in a file; `sigma_m` is the mean over the two axes."""
        return {
            "t_s": self.t_s,
            "arrival_s": self.arrival_s,
            "x_m": self.position[:, 0],
            "y_m": self.position[:, 1],
            "z_m": self.position[:, 2],
            "sigma_m": np.sqrt((self.covariance[:, 0] + self.covariance[:, 2]) / 2.0),
            "confidence": self.confidence,
        }

    def to_numpy(self) -> Arrays:
        """Make arrays of `columns`."""
        return arrays(self.columns())

    def to_arrow(self) -> ArrowTable:
        """Make a `pyarrow.Table` of `columns`; `ImportError` without the extra `data`."""
        return arrow_table(self.columns())

    def to_pandas(self) -> DataFrame:
        """Make a `pandas.DataFrame` of `columns`; `ImportError` without the extra `data`."""
        return data_frame(self.columns())


class Report(NamedTuple):
    """A position that localization made of one scan; position (d,) [m], covariance (d, d) [m^2]."""

    t_s: float
    position: Vector
    covariance: Matrix


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """Where targets really were: columns (n,), `position` (n, 3) [m]; z is NaN where unknown."""

    t_s: Vector
    target: Indices
    position: Matrix
    target_ids: tuple[str, ...]

    def __len__(self) -> int:
        return int(self.t_s.size)

    def columns(self) -> Columns:
        """Columns as in a file; views, not copies."""
        return {
            "t_s": self.t_s,
            "target_id": Names(self.target, self.target_ids),
            "x_m": self.position[:, 0],
            "y_m": self.position[:, 1],
            "z_m": self.position[:, 2],
        }

    def to_numpy(self) -> Arrays:
        """Make arrays of `columns`: names as text, None where there is none."""
        return arrays(self.columns())

    def to_arrow(self) -> ArrowTable:
        """Make a `pyarrow.Table` of `columns`; `ImportError` without the extra `data`."""
        return arrow_table(self.columns())

    def to_pandas(self) -> DataFrame:
        """Make a `pandas.DataFrame` of `columns`; `ImportError` without the extra `data`."""
        return data_frame(self.columns())


class Status(IntEnum):
    """Life of a track; tentative rows are not counted as shown."""

    TENTATIVE = 0
    CONFIRMED = 1
    COASTING = 2
    ENDED = 3


STATUS_WORDS = tuple(status.name.lower() for status in Status)


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """What the tracker showed: one row per track and update.

    `position` and `velocity` (n, 3) [m], [m/s]; `covariance` (n, 3) holds xx, xy, yy of the
    position [m^2]; `status` (n,) holds `Status`; `track` (n,) is the track's number, `target`
    indexes `target_ids` (-1: unknown target); `nis` (n,) is the normalised innovation squared of
    the update divided by its number of readings (NaN for a row without an update).
    """

    t_s: Vector
    track: Indices
    position: Matrix
    velocity: Matrix
    covariance: Matrix
    status: Indices
    target: Indices
    nis: Vector
    target_ids: tuple[str, ...]

    def __len__(self) -> int:
        return int(self.t_s.size)

    def columns(self) -> Columns:
        """Columns as in a file, and `nis`, which files do not have; views, not copies."""
        return {
            "t_s": self.t_s,
            "track_id": self.track,
            "x_m": self.position[:, 0],
            "y_m": self.position[:, 1],
            "z_m": self.position[:, 2],
            "vx_m_s": self.velocity[:, 0],
            "vy_m_s": self.velocity[:, 1],
            "vz_m_s": self.velocity[:, 2],
            "cov_xx": self.covariance[:, 0],
            "cov_xy": self.covariance[:, 1],
            "cov_yy": self.covariance[:, 2],
            "status": Names(self.status, STATUS_WORDS),
            "target_id": Names(self.target, self.target_ids),
            "nis": self.nis,
        }

    def to_numpy(self) -> Arrays:
        """Make arrays of `columns`: names as text, None where there is none."""
        return arrays(self.columns())

    def to_arrow(self) -> ArrowTable:
        """Make a `pyarrow.Table` of `columns`; `ImportError` without the extra `data`."""
        return arrow_table(self.columns())

    def to_pandas(self) -> DataFrame:
        """Make a `pandas.DataFrame` of `columns`; `ImportError` without the extra `data`."""
        return data_frame(self.columns())


class Mode(IntEnum):
    """What a sensor node does in an interval, by rising power: Pham's s_i in {0, 1, 2, 3}.

    `SLEEPING` keeps its clock only; `ACTIVE` listens, ready to be told; `SENSING` measures and
    sends; `MASTER` receives what the sensing ones send, filters and schedules.
    """

    SLEEPING = 0
    ACTIVE = 1
    SENSING = 2
    MASTER = 3


MODE_WORDS = tuple(mode.name.lower() for mode in Mode)


@dataclass(frozen=True, slots=True, eq=False)
class Commands:
    """What sensor nodes are told to do: one row a node whose mode changes; columns (n,).

    `sensor` indexes `sensor_ids`, `mode` holds `Mode`; a node stays in its mode until its next row,
    and all sleep before the first.
    """

    t_s: Vector
    sensor: Indices
    mode: Indices
    sensor_ids: tuple[str, ...]

    def __len__(self) -> int:
        return int(self.t_s.size)

    def columns(self) -> Columns:
        """Columns as in a file; views, not copies."""
        return {
            "t_s": self.t_s,
            "sensor_id": Names(self.sensor, self.sensor_ids),
            "mode": Names(self.mode, MODE_WORDS),
        }

    def to_numpy(self) -> Arrays:
        """Make arrays of `columns`: names as text."""
        return arrays(self.columns())

    def to_arrow(self) -> ArrowTable:
        """Make a `pyarrow.Table` of `columns`; `ImportError` without the extra `data`."""
        return arrow_table(self.columns())

    def to_pandas(self) -> DataFrame:
        """Make a `pandas.DataFrame` of `columns`; `ImportError` without the extra `data`."""
        return data_frame(self.columns())


Table = TypeVar("Table", Readings, Reports, Truth, Tracks, Commands)


def select_rows(table: Table, rows: NDArray[Any] | slice) -> Table:
    """Rows of a table by a mask (n,), numbers or a slice, in that order; all names stay."""
    columns = {
        field.name: getattr(table, field.name)[rows]
        for field in fields(table)
        if isinstance(getattr(table, field.name), np.ndarray)
    }
    return replace(table, **columns)


def join_rows(parts: Sequence[Table]) -> Table:
    """Join rows of one run in the order of `parts`, at least one; the last knows all names."""
    last = parts[-1]
    filled = [part for part in parts if len(part)] or [last]
    columns = {
        field.name: np.concatenate([getattr(part, field.name) for part in filled])
        for field in fields(last)
        if len(filled) > 1 and isinstance(getattr(last, field.name), np.ndarray)
    }
    names = {
        field.name: getattr(last, field.name)
        for field in fields(last)
        if isinstance(getattr(last, field.name), tuple)
    }
    return replace(filled[0], **columns, **names)


def _arrow_array(arrow: ModuleType, column: NDArray[Any] | Names) -> object:
    if not isinstance(column, Names):
        return arrow.array(column, from_pandas=True)
    places = arrow.array(column.places, mask=column.places < 0)
    return arrow.DictionaryArray.from_arrays(places, arrow.array(column.names, arrow.string()))


def _optional(module: str) -> ModuleType:
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ImportError(f'{module} is missing: pip install "trackfield[data]"') from error
