"""What a run of reports looks like beside its site, looked at chunk by chunk."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from trackfield.network.site import Site
from trackfield.network.timing import Timing, no_rows, timed
from trackfield.pipeline.intake import report_rows
from trackfield.pipeline.scene import watched
from trackfield.types import Reports


@dataclass(frozen=True, slots=True, eq=False)
class ReportSurvey:
    """A run so far: when reports came, and how many lay outside the region.

    `delay_s` is the sum over the `told` reports that say when they arrived.
    """

    site: Site
    timing: Timing
    outside: int = 0
    told: int = 0
    delay_s: float = 0.0

    @property
    def per_step(self) -> float:
        """Reports a step, over the whole run."""
        span_s = self.timing.last_s - self.timing.first_s
        return self.timing.rows / (round(span_s / (self.site.reports.step_s or 1.0)) + 1)

    @property
    def mean_delay_s(self) -> float | None:
        """Mean delay of the reports that say when they arrived; None where none does."""
        return self.delay_s / self.told if self.told else None


def no_reports(site: Site) -> ReportSurvey:
    """Begin a survey for a run on `site`, whose region and step are settled."""
    return ReportSurvey(site, no_rows(3))


def with_reports(survey: ReportSurvey, reports: Reports) -> ReportSurvey:
    """Add a chunk of reports."""
    site, counts = survey.site, Counter[str]()
    region = watched(site)
    if region is not None:
        report_rows(reports, region, sigma_m=site.reports.sigma_m, counts=counts)
    rows = np.column_stack([reports.t_s, reports.position[:, :2]])
    window_s = site.tracker.window_steps * (site.reports.step_s or 1.0)
    delay = reports.arrival_s - reports.t_s
    told = np.isfinite(delay)
    return replace(
        survey,
        timing=timed(survey.timing, reports.t_s, rows, window_s=window_s),
        outside=survey.outside + counts["outside"],
        told=survey.told + int(np.count_nonzero(told)),
        delay_s=survey.delay_s + float(delay[told].sum()),
    )
