"""The default tracker of a beacon by signal strength: what it believes, and a step of it.

A Rao-Blackwellised particle filter (`rssi_cloud`) on the site's radio map: strengths are the law of
each receiver, its surveyed shadow, what the survey left open (followed particle by particle over
the distance travelled), an offset of the beacon's power, and white noise with blocked and outlying
readings.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trackfield.errors import InputError
from trackfield.filtering import rssi_state
from trackfield.filtering.rssi_cloud import (
    Cloud,
    carried,
    effective,
    going,
    joined,
    moments,
    resampled,
    weights,
)
from trackfield.filtering.rssi_evidence import PathBelief, hear, surprise
from trackfield.filtering.rssi_modes import APART, MIRRORED_APART, parted
from trackfield.filtering.rssi_prior import RssiPrior, rssi_prior
from trackfield.filtering.rssi_state import RssiState
from trackfield.filtering.scans import Scan, Shown
from trackfield.network.site import Site
from trackfield.types import Indices, Matrix, Status, Vector

_TICK_S = 0.02  # readings so near in time are taken without a motion between them
_SILENT_S = 3.0  # without readings for longer a track is coasting
_SURE = 6  # readings from which on a track is confirmed
_SLOTS = 24  # receivers whose shadows are followed at a time
_START = 4  # times as many particles until the first drawing
_LOST = 0.05  # share of particles that look whether the beacon is anywhere else ...
_CARRIED_OFF = 1e-3  # ... with this probability, at each drawing


@dataclass(frozen=True, slots=True, eq=False)
class RssiFilter:
    """A `ScanFilter` of signal strengths; made by `create`."""

    prior: RssiPrior
    particles: int
    drop_s: float
    seed: int
    shows_height: bool

    def start(self) -> RssiState:
        """Return the state of a beacon of which nothing was heard."""
        return RssiState()

    def step(self, state: RssiState, scan: Scan) -> RssiState:
        """Condition on a scan no earlier than the last one.

        `InputError` for one that is, for a strength that is no finite number, for no such receiver.
        """
        self._check(state, scan)
        if scan.value.size == 0:
            return state
        if scan.t_s - state.t_s > self.drop_s:
            state = RssiState(draws=state.draws)
        rng = self._rng(state.draws)
        if state.cloud is None:
            cloud, moved_s = self.prior.spread(rng, _START * self.particles), scan.t_s
            state = state._replace(born=state.draws)
        elif scan.t_s - state.moved_s >= _TICK_S:
            cloud, moved_s = self.prior.moved(state.cloud, scan.t_s - state.moved_s, rng), scan.t_s
        else:
            cloud, moved_s = state.cloud, state.moved_s
        nis = 0.0
        for rows in _rounds(scan.sensor):
            part = Scan(scan.t_s, scan.sensor[rows], scan.value[rows], scan.sigma[rows])
            cloud, squares = self._heard(cloud, part)
            nis += squares
        parent = None
        if effective(cloud) < 0.5 * self.particles or cloud.moves.size > self.particles:
            cloud, parent = self._drawn(cloud, rng)
        return RssiState(
            scan.t_s,
            moved_s,
            state.heard + scan.value.size,
            state.draws + 1,
            state.born,
            nis / scan.value.size,
            cloud,
            parent,
        )

    def shown(self, state: RssiState, t_s: float) -> Shown | None:
        """Carry the belief to `t_s`; None before the first reading.

        A track is confirmed when enough was heard, unless the beacon may as well be in two places.
        """
        cloud = state.cloud
        if cloud is None:
            return None
        return self._show(state, t_s, cloud.position, going(cloud), w=weights(cloud))

    def hindsight(self, states: Sequence[RssiState]) -> Shown | None:
        """Estimate the beacon at the time of `states[0]`: where the last particles were then.

        Particles that the last state found anew say nothing of the first one.
        """
        first, last = states[0], states[-1]
        if first.cloud is None or last.cloud is None:
            return self.shown(first, first.t_s)
        w = weights(last.cloud)
        place = np.arange(w.size, dtype=np.int32)
        for state in reversed(states[1:]):
            if state.born != first.born:
                return self.shown(first, first.t_s)
            if state.parent is not None:
                place = np.where(place >= 0, state.parent[place], -1)
        known = place >= 0
        if not w[known].sum() > 0.0:
            return self.shown(first, first.t_s)
        place, w = place[known], w[known] / w[known].sum()
        velocity = going(first.cloud)[:, place]
        return self._show(first, first.t_s, first.cloud.position[:, place], velocity, w=w)

    def pack(self, state: RssiState) -> bytes:
        """Bytes that `unpack` makes the very same state of."""
        return rssi_state.pack(state)

    def unpack(self, data: bytes) -> RssiState:
        """Return the state that was packed; `StateError` for other bytes."""
        return rssi_state.unpack(data)

    def _check(self, state: RssiState, scan: Scan) -> None:
        if not scan.t_s >= state.t_s:
            raise InputError(f"found a scan at {scan.t_s} s, expected none before {state.t_s} s")
        if not np.all(np.isfinite(scan.value)):
            raise InputError(f"found a strength of {scan.value} dBm, expected finite numbers")
        n = len(self.prior.field.sensors)
        if scan.sensor.size and not 0 <= scan.sensor.min() <= scan.sensor.max() < n:
            raise InputError(f"found receivers {scan.sensor}, expected 0 to {n - 1}")

    def _rng(self, draws: int) -> np.random.Generator:
        """Return the random stream of one step: a state's future does not depend on its past."""
        return np.random.Generator(np.random.Philox(key=self.seed, counter=[0, 0, draws, 0]))

    def _heard(self, cloud: Cloud, scan: Scan) -> tuple[Cloud, float]:
        """Condition on readings of different receivers; also the sum of their squared surprises."""
        cloud, slots = self._followed(cloud, scan.sensor)
        models = self.prior.field.models
        own = models.sigma_db[scan.sensor]
        sigma = np.where(np.isfinite(scan.sigma), scan.sigma, own)
        off = scan.value[:, None] - self.prior.field.strength(scan.sensor, cloud.position)
        off -= cloud.offset_db
        path = PathBelief(cloud.shadow_db[slots], cloud.shadow_var[slots], cloud.blocked[slots])
        nis = surprise(models, scan.sensor, off_db=off, path=path, w=weights(cloud), sigma_db=sigma)
        heard = hear(models, scan.sensor, off_db=off, sigma_db=sigma, path=path)
        log_weight = cloud.log_weight + heard.log_likelihood
        now = PathBelief(cloud.shadow_db.copy(), cloud.shadow_var.copy(), cloud.blocked.copy())
        for old, new in zip(now, heard.path, strict=True):
            old[slots] = new
        cloud = cloud._replace(log_weight=log_weight - log_weight.max(), **now._asdict())
        return cloud, nis

    def _followed(self, cloud: Cloud, receivers: Indices) -> tuple[Cloud, Indices]:
        """Make room for the shadows of `receivers` (m,), and tell their rows (m,)."""
        new = receivers[~np.isin(receivers, cloud.receiver)]
        if new.size:
            usual = self.prior.usual(new, cloud.position)
            kept = ~np.isin(cloud.receiver, receivers)
            idle = np.flatnonzero(kept)[: max(cloud.receiver.size + new.size - _SLOTS, 0)]
            stay = np.delete(np.arange(cloud.receiver.size), idle)
            cloud = cloud._replace(
                receiver=np.concatenate([cloud.receiver[stay], new]),
                shadow_db=np.concatenate([cloud.shadow_db[stay], np.zeros_like(usual.shadow_var)]),
                shadow_var=np.concatenate([cloud.shadow_var[stay], usual.shadow_var]),
                blocked=np.concatenate([cloud.blocked[stay], usual.blocked]),
            )
        order = np.argsort(cloud.receiver, kind="stable")
        rows = order[np.searchsorted(cloud.receiver, receivers, sorter=order)]
        return cloud, rows.astype(np.int32)

    def _drawn(self, cloud: Cloud, rng: np.random.Generator) -> tuple[Cloud, Indices]:
        """Particles of equal weight, and few that look whether the beacon was carried off."""
        lookers = math.ceil(_LOST * self.particles)
        drawn, parent = resampled(cloud, rng.random(), self.particles - lookers)
        drawn = self.prior.on_either_side(drawn, rng)
        anew = self.prior.spread(rng, lookers)
        usual = self.prior.usual(cloud.receiver, anew.position)
        light = math.log(_CARRIED_OFF / (1.0 - _CARRIED_OFF) * drawn.moves.size / lookers)
        anew = anew._replace(
            log_weight=np.full(lookers, light),
            receiver=cloud.receiver,
            shadow_db=np.zeros_like(usual.shadow_var),
            shadow_var=usual.shadow_var,
            blocked=usual.blocked,
        )
        return joined(drawn, anew), np.concatenate([parent, np.full(lookers, -1, np.int32)])

    def _show(
        self, state: RssiState, t_s: float, position: Matrix, velocity: Matrix, *, w: Vector
    ) -> Shown:
        m = carried(moments(position, velocity, w), t_s - state.moved_s, self.prior.walk)
        silent = t_s - state.t_s
        if silent > self.drop_s:
            status = Status.ENDED
        elif state.heard < _SURE or self._doubtful(position, w):
            status = Status.TENTATIVE
        else:
            status = Status.COASTING if silent > _SILENT_S else Status.CONFIRMED
        place = m.position.copy()
        if not self.shows_height:
            place[2] = math.nan
        C = m.covariance
        covariance = np.array([C[0, 0], C[0, 1], C[1, 1]])
        nis = state.nis if t_s == state.t_s else math.nan
        return Shown(t_s, place, m.velocity, covariance, status, nis)

    def _doubtful(self, position: Matrix, w: Vector) -> bool:
        """Tell whether the beacon may as well be in two places."""
        apart = APART if self.prior.mirror is None else MIRRORED_APART
        return parted(position, w, apart=apart)


def create(site: Site, *, particles: int = 1500, seed: int = 0) -> RssiFilter:
    """Filter of one beacon with the site's models and survey.

    `ConfigurationError` if a sensor measures something else.
    """
    return RssiFilter(
        rssi_prior(site),
        particles,
        site.tracker.drop_s,
        seed,
        site.target.dimensions == 3 or site.target.height_m is not None,
    )


def _rounds(receivers: Indices) -> list[Indices]:
    """Rows of a scan such that no receiver speaks twice in one round; as a rule one round."""
    seen: dict[int, int] = {}
    turn = np.empty(receivers.size, np.int32)
    for row, receiver in enumerate(receivers.tolist()):
        turn[row] = seen[receiver] = seen.get(receiver, -1) + 1
    return [np.flatnonzero(turn == k).astype(np.int32) for k in range(int(turn.max()) + 1)]
