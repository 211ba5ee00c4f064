"""Travel times of packets as the modems measure them (docs/design/comms.md).

    measured = distance / (speed (1 + c)) + receiver's clock error - sender's clock error + noise or echo delay

The distance is from the sender's position at the transmission to the receiver's position at the first arrival. A
clock's error is its offset before the dive plus its drift. `c` is constant during a mission: the relative error of the
assumed speed of sound.
"""

import math

import numpy as np

from auv_lse_common.mission_file.sections.world import RangingConfig


class Ranging:
    """Measured travel times.

    Args:
        rng: Source of its random numbers; each arrival, readable or not, draws the same number.
    """

    def __init__(
        self, config: RangingConfig, vehicles: int, sound_speed_mps: float, rng: np.random.Generator, ideal: bool
    ) -> None:
        """Draws the clocks and the speed of sound."""
        self.config = config
        self._rng = rng
        self._ideal = ideal or config.ideal
        draws = rng.standard_normal(1 + 2 * vehicles)
        self._speed_mps = sound_speed_mps * (1.0 if self._ideal else 1.0 + config.sound_speed_error * float(draws[0]))
        self._offset_s = config.clock_offset_s * draws[1 : 1 + vehicles]
        self._rate = 1e-6 * config.clock_drift_ppm * draws[1 + vehicles :]

    def clock_error_s(self, vehicle: int, now_s: float) -> float:
        """Error of a vehicle's clock (s); positive means ahead."""
        return 0.0 if self._ideal else float(self._offset_s[vehicle - 1] + self._rate[vehicle - 1] * now_s)

    def travel_s(self, source: int, receiver: int, sent_s: float, distance_m: float) -> float:
        """The measured travel time (s) of sound from `source`, sent at `sent_s`, over `distance_m` to `receiver`."""
        noise, echo, late = self._rng.standard_normal(), self._rng.random(), self._rng.random()
        true_s = distance_m / self._speed_mps
        if self._ideal:
            return true_s
        clocks_s = self.clock_error_s(receiver, sent_s + true_s) - self.clock_error_s(source, sent_s)
        error_s = self.config.noise_s * noise
        if echo < self.config.echo_share:
            error_s -= self.config.echo_s * math.log1p(-late)
        return true_s + clocks_s + error_s
