"""From tables to scans: reports as they are, or positions fitted to the signals of a step."""

from __future__ import annotations

from collections import Counter
from typing import Literal, Protocol

import numpy as np

from trackfield.association.contract import ReportScan
from trackfield.errors import InputError
from trackfield.network.site import Site
from trackfield.pipeline.intake import REPORT_KEYS, Rows, report_rows
from trackfield.pipeline.slots import Late
from trackfield.raster import Region
from trackfield.types import Matrix, Readings, Reports

Source = Literal["reports", "signal", "detection"]
Table = Reports | Readings


class Front(Protocol):
    """What a tracker sees of a kind of data: rows of a table, and the scan of a step's rows."""

    @property
    def width(self) -> int:
        """Columns of a row."""
        ...

    @property
    def keys(self) -> int:
        """Columns, the first ones, in which two rows differ if they are not copies."""
        ...

    @property
    def most(self) -> int:
        """Rows that a step takes; more are a flood."""
        ...

    def rows(self, table: Table, counts: Counter[str]) -> Rows:
        """Rows of a table; counts what is left out. `InputError` for what cannot be used."""
        ...

    def scan(self, t_s: float, rows: Matrix, number: int) -> ReportScan:
        """Scan of the rows of a step; its reports are numbered from `number` on."""
        ...

    def late(self, t_s: float, late: Late, number: int) -> ReportScan:
        """Make the scan that late rows add to that of their step."""
        ...


class ReportFront:
    """Reports as they are."""

    width, keys, most = 6, REPORT_KEYS, 5000

    def __init__(self, site: Site, region: Region) -> None:
        self._sigma_m, self._region = site.reports.sigma_m, region

    def rows(self, table: Table, counts: Counter[str]) -> Rows:
        """Rows t, x, y, xx, xy, yy of the reports in the region."""
        if not isinstance(table, Reports):
            raise InputError(f"found {type(table).__name__}, expected Reports")
        return report_rows(table, self._region, sigma_m=self._sigma_m, counts=counts)

    def scan(self, t_s: float, rows: Matrix, number: int) -> ReportScan:
        """Put the reports of a step from west to east: in which order they came plays no part."""
        ordered = rows[np.lexsort(rows[:, :0:-1].T)]
        numbers = np.arange(number, number + len(rows), dtype=np.int32)
        return ReportScan(t_s, ordered[:, 1:3].copy(), ordered[:, 3:].copy(), numbers)

    def late(self, t_s: float, late: Late, number: int) -> ReportScan:
        """Make a scan of the late reports."""
        return self.scan(t_s, late.rows[late.given :], number)
