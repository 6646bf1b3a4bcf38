"""The job that each peer does with a message: parse it, filter its vehicle, compare with a gate. Standard library only.

A peer runs in an environment of its own, without headway. The filter is a Kalman filter of position and speed at
constant speed, in plain Python: cheaper than any library's. `Report` says every quarter of a second what is done.
"""

import json
import socket
import threading
import time
from typing import Any, NamedTuple

METRES_PER_DEGREE = 111_000.0
ACCELERATION_VARIANCE, POSITION_VARIANCE, SPEED_VARIANCE = 1.0, 1.0, 0.04
GATE = 13.8
"""Of the squared innovation of two readings: one in a thousand."""
EVERY_S = 0.25
_BITS = 5
"""Leading bits of a latency that are kept: 3 %."""


class Message(NamedTuple):
    """What the job needs of a record of BSM v1."""

    vehicle: str
    t_us: int
    x_m: float
    v_mps: float


State = tuple[int, float, float, float, float, float]
"""Time, position, speed, and their variances and covariance."""


def parse(line: str | bytes) -> Message:
    """Read a JSON array with the fields of BSM v1 in their order."""
    _, vehicle, _, t_us, lat, _, speed_mps, *_ = json.loads(line)
    return Message(vehicle, t_us, lat * METRES_PER_DEGREE, speed_mps)


def step(state: State | None, message: Message) -> tuple[State, bool]:
    """Return the state after a message, and whether the message is an alarm."""
    _, t_us, x_m, v_mps = message
    if state is None:
        return (t_us, x_m, v_mps, POSITION_VARIANCE, 0.0, SPEED_VARIANCE), False
    last_us, x, v, p_xx, p_xv, p_vv = state
    dt = (t_us - last_us) / 1e6
    x += v * dt
    p_xx += dt * (2.0 * p_xv + dt * p_vv) + ACCELERATION_VARIANCE * dt**4 / 4.0
    p_xv += dt * p_vv + ACCELERATION_VARIANCE * dt**3 / 2.0
    p_vv += ACCELERATION_VARIANCE * dt**2
    s_xx, s_vv = p_xx + POSITION_VARIANCE, p_vv + SPEED_VARIANCE
    determinant = s_xx * s_vv - p_xv * p_xv
    dx, dv = x_m - x, v_mps - v
    nis = (s_vv * dx * dx - 2.0 * p_xv * dx * dv + s_xx * dv * dv) / determinant
    k_xx, k_xv = (p_xx * s_vv - p_xv * p_xv) / determinant, p_xv * POSITION_VARIANCE / determinant
    k_vx, k_vv = p_xv * SPEED_VARIANCE / determinant, (p_vv * s_xx - p_xv * p_xv) / determinant
    x, v = x + k_xx * dx + k_xv * dv, v + k_vx * dx + k_vv * dv
    after = (t_us, x, v, k_xx * POSITION_VARIANCE, k_xv * SPEED_VARIANCE, k_vv * SPEED_VARIANCE)
    return after, nis > GATE


class Latencies:
    """A histogram of the time from the event time of a message, when it was sent, to its verdict."""

    def __init__(self) -> None:
        self.buckets: dict[int, int] = {}

    def add(self, t_us: int) -> None:
        """Count a message that is judged now."""
        late_us = max(time.time_ns() // 1000 - t_us, 1)
        edge = late_us | (1 << max(0, late_us.bit_length() - _BITS)) - 1
        self.buckets[edge] = self.buckets.get(edge, 0) + 1


class Report:
    """Counts of one instance of a job, sent by UDP to `host:port` from a thread."""

    def __init__(self, address: str, instance: str) -> None:
        host, port = address.split(":")
        self._to, self._instance = (host, int(port)), instance
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._latencies = Latencies()
        self._judged = self._alarms = 0
        threading.Thread(target=self._run, daemon=True).start()

    def add(self, message: Message, *, is_alarm: bool) -> None:
        """Count a verdict."""
        self._judged += 1
        self._alarms += is_alarm
        self._latencies.add(message.t_us)

    def _run(self) -> None:
        while True:
            time.sleep(EVERY_S)
            content: dict[str, Any] = {"instance": self._instance, "judged": self._judged, "alarms": self._alarms}
            content["buckets"] = list(self._latencies.buckets.copy().items())
            self._socket.sendto(json.dumps(content).encode(), self._to)
