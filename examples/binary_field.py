"""Two walkers cross a field of binary sensors: tracks straight from ones and silences."""

from __future__ import annotations

import numpy as np

from trackfield.association.detect import Detect, ReadingScan
from trackfield.association.detect_field import DetectField
from trackfield.sensing.detection import DetectionModel, simulate

X, Y = np.meshgrid(5.0 * np.arange(12), 5.0 * np.arange(12))
SENSORS = np.column_stack([X.ravel(), Y.ravel()])
MODEL = DetectionModel(radius_m=7.62, p_detection=0.7, p_false=0.05, edge_m=1.0)


def main() -> None:
    """Follow them for 45 s; six nodes are dead and one message in ten is lost."""
    rng = np.random.default_rng(3)
    t = np.arange(1.0, 46.0)[:, None]
    paths = np.stack(
        [
            np.hstack([1.2 * t, 20.0 + 0.2 * t]),
            np.hstack([26.0 + 0.1 * t, 55.0 - 1.2 * t]),
        ],
        axis=1,
    )  # (steps, walkers, 2)
    dead = rng.choice(len(SENSORS), 6, replace=False)
    alive = ~np.isin(np.arange(len(SENSORS)), dead)
    said = simulate(MODEL, SENSORS, paths=paths, rng=rng, delivery=0.9, alive=alive)

    tracker = Detect(DetectField(SENSORS, MODEL, delivery=0.9))
    state = tracker.initial(seed=1)
    for step, received in enumerate(said.received):
        value = np.where(received, 1, -1).astype(np.int8)  # -1: nothing was heard of it
        state, _ = tracker.step(state, ReadingScan(float(t[step, 0]), value))
        if (step + 1) % 9 == 0:
            found = tracker.estimates(state)
            rows = zip(found.track[found.shown], found.mean[found.shown], strict=True)
            tracks = ", ".join(f"{i} at ({m[0]:.1f}, {m[1]:.1f})" for i, m in rows)
            truth = " and ".join(f"({x:.1f}, {y:.1f})" for x, y in paths[step])
            print(f"{t[step, 0]:3.0f} s: track {tracks}; walkers at {truth}")

    found = tracker.estimates(state)
    why = tracker.explain(state, int(found.track[found.shown][0]))
    if why is not None:
        print(f"track {why.track} is there because of sensors {why.sensors[:5].tolist()}")
    silent, _ = tracker.nodes(state)
    believed = np.flatnonzero(silent > 0.5).tolist()
    print(f"believed dead: {believed}; are dead: {sorted(dead.tolist())}")


if __name__ == "__main__":
    main()
