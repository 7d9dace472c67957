"""What one sensor hears of one target, sample by sample, and the messages that become of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from trackfield.localization.pass_stream import SensorMessage
from trackfield.sensing.amplitude import AmplitudeModel
from trackfield.sensing.profile import Profile
from trackfield.sensing.profile_fit import LEAST_SAMPLES, ProfileFit, Quality, fit

MOST_SAMPLES = 4096  # of a record: what is older is forgotten
_LOUD = 12.0  # log-likelihood that a pass must gain over nothing before it is told
_PASSED = 1.0  # widths after the closest approach, where half the amplitude is left: first told
_GONE = 3.0  # the same, where a fifth is left in free space: the record of this pass ends
_PEAK = 3.0  # standard deviations: without any sample so strong nothing is looked for
_PATIENCE = 16  # a record is fitted again when it has grown by one part in so many
_SMOOTHED = 32  # what was left off before is looked for in means of one part in so many of a record
_FALLEN = 2.0  # standard errors by which it falls before what follows rises,
_RISES = 6.0  # and by which that does
_WHOLE = (Quality.GOOD, Quality.CLIPPED)
_PARTIAL = (*_WHOLE, Quality.NOT_PASSED, Quality.FLAT, Quality.EMPTY)


class Said(NamedTuple):
    """A message, and its key: `pass_number` counts the passes that the sensor has told."""

    pass_number: int
    message: SensorMessage


@dataclass(slots=True, eq=False)
class PassRecord:
    """Samples of one sensor in order of time, and how far the pass in them is.

    The first message of a pass comes when the amplitude has fallen to half of its maximum, a better
    one in its place when the target is gone; then a record of the next pass begins.
    """

    sensor: int
    x_m: float
    y_m: float
    model: AmplitudeModel
    t_s: list[float] = field(default_factory=list[float])
    value: list[float] = field(default_factory=list[float])
    told: bool = False
    pass_number: int = 0
    fit_at: int = LEAST_SAMPLES  # samples at which the record is fitted next
    peak: float = -math.inf

    def add(self, t_s: float, value: float) -> Said | None:
        """Take a sample later than all before; a message, where there is one now."""
        self.t_s.append(t_s)
        self.value.append(value)
        self.peak = max(self.peak, value)
        count = len(self.t_s)
        if count < self.fit_at or self.peak < _PEAK * self.model.sigma:
            if count > MOST_SAMPLES:
                self._begin(count // 2)
            return None
        self.fit_at = count + max(2, count // _PATIENCE)
        found = self._fit()
        said = self._judged(found, t_s)
        if len(self.t_s) > MOST_SAMPLES:
            self._begin(len(self.t_s) // 2)
        return said

    def finish(self) -> Said | None:
        """End the record: say what is there, a pass or part of one, weak as it may be."""
        if len(self.t_s) < LEAST_SAMPLES:
            return None
        found = self._fit()
        quality = Quality(int(found.quality))
        later = self.told or self.pass_number > 0  # after a pass, what is left over is no news
        if later and (quality not in _WHOLE or float(found.gain) < _LOUD):
            return None
        if not (self.told or self._is_news()):
            return None
        return self._said(found) if quality in _PARTIAL else None

    def _judged(self, found: ProfileFit, now_s: float) -> Said | None:
        quality = Quality(int(found.quality))
        since = (now_s - float(found.profile.t_max_s)) / float(found.profile.width_s)
        clear = quality in _WHOLE and float(found.gain) > _LOUD
        if not self.told:
            if quality == Quality.MISFIT:
                self._leave_behind()
            if not (clear and since >= _PASSED and self._is_news()):
                return None
            self.told = True
            return self._said(found)
        if not clear:  # something else is heard by now
            self._next()
            return None
        if since < _GONE:
            return None
        said = self._said(found)
        self._next()
        return said

    def _next(self) -> None:
        """Begin the record of the next pass."""
        self._begin(len(self.t_s))
        self.pass_number += 1
        self.told = False

    def _is_news(self) -> bool:
        """Tell whether this is more than the end of the pass before: that one only falls."""
        return self.pass_number == 0 or self._valley()[2] > _RISES

    def _leave_behind(self) -> None:
        """Forget what falls before it rises again: the end of the pass of a target before."""
        low, fall, rise = self._valley()
        if fall > _FALLEN and rise > _RISES:
            self._begin(low)

    def _valley(self) -> tuple[int, float, float]:
        """Find where the amplitude is least before it is greatest, in means of some samples.

        Also how far it has fallen since the record's beginning, and how far it rises then, in
        standard errors.
        """
        value = np.array(self.value)
        width = max(LEAST_SAMPLES, len(value) // _SMOOTHED)
        if len(value) < 4 * width:
            return 0, 0.0, 0.0
        mean = np.convolve(value, np.full(width, 1.0 / width), "valid")
        high = int(mean.argmax())
        low = int(mean[: high + 1].argmin())
        fading = self.model.fading == "rayleigh"
        error = np.sqrt(2.0 / width) * np.hypot(self.model.sigma, mean[[0, high]] * fading)
        fall, rise = (mean[[0, high]] - mean[low]) / error
        return low + width // 2, float(fall), float(rise)

    def _begin(self, first: int) -> None:
        """Forget the samples before number `first`."""
        del self.t_s[:first], self.value[:first]
        self.peak = max(self.value, default=-math.inf)
        self.fit_at = max(LEAST_SAMPLES, len(self.t_s) + 1)

    def _fit(self) -> ProfileFit:
        return fit(self.model, np.array(self.t_s), np.array(self.value))

    def _said(self, found: ProfileFit) -> Said:
        profile = Profile(*(float(number) for number in found.profile))
        count = len(self.t_s)
        step_s = (self.t_s[-1] - self.t_s[0]) / (count - 1)
        about = self.sensor, self.x_m, self.y_m, self.model
        return Said(self.pass_number, SensorMessage(*about, profile, self.t_s[0], step_s, count))

    def plain(self) -> list[Any]:
        """Plain values that `restored` takes back, exactly."""
        return [self.t_s, self.value, self.told, self.pass_number, self.fit_at]

    def restore(self, plain: list[Any]) -> None:
        """Take up the record where `plain` left it."""
        self.t_s, self.value, self.told, self.pass_number, self.fit_at = plain
        self.peak = max(self.value, default=-math.inf)
