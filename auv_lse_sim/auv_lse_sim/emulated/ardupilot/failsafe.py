"""Failsafes of ArduSub and ArduRover: a silent ground station, a silent pilot, a leak.

A ground station counts once its heartbeat has been heard. Until then its silence has no effect; afterwards the vehicle
reacts to it each time it is armed.
"""

import enum
import math

from auv_lse_sim.emulated.ardupilot.parameters import Parameters
from auv_lse_sim.emulated.ardupilot.personality import Personality

#: Time (s) after which the text on a silent ground station, and that on a leak, is repeated.
GCS_TEXT_S, LEAK_TEXT_S = 30.0, 20.0
#: MAV_SEVERITY of the texts.
CRITICAL, WARNING, INFO = 2, 4, 6


class Response(enum.Enum):
    """The reaction of a failsafe."""

    NOTHING = "nothing"
    DISARM = "disarm"
    HOLD = "hold"
    SURFACE = "surface"


#: Reaction to a lost ground station by the value of ArduSub's FS_GCS_ENABLE.
_SUB_GCS = {2: Response.DISARM, 3: Response.HOLD, 4: Response.SURFACE}


class Failsafes:
    """The failsafes of one autopilot.

    Attributes:
        leaks: Whether water is in the hull.
    """

    def __init__(self, personality: Personality, parameters: Parameters, patience: float = 1.0) -> None:
        """Starts without a ground station; `patience` is a factor on the time for which it may be silent."""
        self.leaks = False
        self._own, self._parameters = personality, parameters
        self._gcs_timeout_s = personality.gcs_timeout_s * patience
        self.boot(-math.inf)

    def boot(self, now_s: float) -> None:
        """Forgets everything."""
        self._gcs_s = math.nan  # when its heartbeat was heard last; NaN: never
        self._pilot_s = now_s
        self._gcs_lost = self._pilot_lost = False
        self._gcs_text_s = self._leak_text_s = -math.inf

    def hear_station(self, now_s: float, system: int) -> None:
        """Handles a heartbeat of a system."""
        if system == round(self._parameters["SYSID_MYGCS"]):
            self._gcs_s = now_s

    def hear_pilot(self, now_s: float) -> None:
        """Handles a joystick's message."""
        self._pilot_s = now_s

    @property
    def is_critical(self) -> bool:
        """Whether HEARTBEAT.system_status is critical."""
        return self._gcs_lost or self._pilot_lost

    def step(self, now_s: float, armed: bool) -> tuple[Response, list[tuple[int, str]]]:
        """Checks for silence and leaks; returns the reaction, and texts with their severities."""
        if math.isinf(self._pilot_s):
            self._pilot_s = now_s
        texts: list[tuple[int, str]] = []
        response = self._step_station(now_s, armed, texts)
        if self._own.surface is None:
            return response, texts
        for other in (self._step_pilot(now_s, armed, texts), self._step_leak(now_s, armed, texts)):
            response = response if other is Response.NOTHING else other
        return response, texts

    def _step_station(self, now_s: float, armed: bool, texts: list[tuple[int, str]]) -> Response:
        setting = round(self._parameters["FS_GCS_ENABLE"])
        silent = now_s - self._gcs_s >= self._gcs_timeout_s  # never heard: NaN, so False
        is_boat = self._own.surface is None
        if setting == 0 or not silent:
            if self._gcs_lost and is_boat:
                texts.append((INFO, f"{self._own.lost_text} Cleared"))
            self._gcs_lost, self._gcs_text_s = False, -math.inf
            return Response.NOTHING
        if now_s - self._gcs_text_s >= (math.inf if is_boat and self._gcs_lost else GCS_TEXT_S):
            self._gcs_text_s = now_s
            texts.append((WARNING, self._own.lost_text.format(round(self._parameters["SYSID_MYGCS"]))))
        if self._gcs_lost or not (armed or is_boat):
            return Response.NOTHING
        self._gcs_lost = True
        return Response.HOLD if is_boat else _SUB_GCS.get(setting, Response.NOTHING)

    def disarmed(self) -> None:
        """Handles disarming: ArduSub reacts again the next time it is armed."""
        if self._own.surface is not None:
            self._gcs_lost = False

    def _step_pilot(self, now_s: float, armed: bool, texts: list[tuple[int, str]]) -> Response:
        setting = round(self._parameters["FS_PILOT_INPUT"])
        if setting == 0 or now_s - self._pilot_s < self._parameters["FS_PILOT_TIMEOUT"]:
            self._pilot_lost = False
            return Response.NOTHING
        if self._pilot_lost:
            return Response.NOTHING
        self._pilot_lost = True
        texts.append((CRITICAL, "Lost manual control"))
        return Response.DISARM if setting == 2 and armed else Response.NOTHING

    def _step_leak(self, now_s: float, armed: bool, texts: list[tuple[int, str]]) -> Response:
        setting = round(self._parameters["FS_LEAK_ENABLE"])
        if not self.leaks or setting == 0:
            self._leak_text_s = -math.inf
            return Response.NOTHING
        first = math.isinf(self._leak_text_s)
        if now_s - self._leak_text_s >= LEAK_TEXT_S:
            self._leak_text_s = now_s
            texts.append((CRITICAL, "Leak Detected"))
        return Response.SURFACE if first and armed and setting == 2 else Response.NOTHING
