"""A recorded robot: learn the radios' errors on one run, track another, live and late."""

from __future__ import annotations

from dataclasses import replace

from trackfield import calibrate, score, track
from trackfield.io.recorded import recorded


def main() -> None:
    """Print how far off the tracks are."""
    learning, judging = recorded("plaza1"), recorded("plaza2")
    learned = calibrate(learning.site, learning.readings, learning.truth).site
    models = dict(zip(learned.sensor_ids, learned.models, strict=True))
    # The same radios stood elsewhere in the second run: their errors go with them.
    site = replace(judging.site, models=tuple(models[name] for name in judging.site.sensor_ids))
    for lag_s in (0.0, 2.0):
        found = score(judging.truth, track(site, judging.readings, lag_s=lag_s))
        print(
            f"lag {lag_s:g} s: RMSE {found.rmse_m:.2f} m, "
            f"{100 * found.inside_95:.0f} % of the truth inside the 95 % ellipse"
        )


if __name__ == "__main__":
    main()
