"""What the service publishes, as messages of the wire contract."""

from collections.abc import Callable, Iterator
from dataclasses import fields
from typing import Any, Final, NamedTuple

from headway.core.types.outcome import Outcome
from headway.core.types.records import Sensor
from headway.core.types.sensor_quality import QualityLevel, QualityStates
from headway.core.types.step_result import AnomalyEvent, PairStates, Phase
from headway.edge.codec.evidence import to_wire
from headway.edge.identity import Identity
from headway.edge.transport.message import Rejection
from headway_schemas import event as wire
from headway_schemas import state as wire_state
from headway_schemas.fields import Message
from headway_schemas.keys import is_id
from headway_schemas.state import PairState, RejectedCopy, SensorQuality, Standing

DETAILS: Final = {
    Outcome.TOO_OLD: "event time further behind the receipt than max_age_s",
    Outcome.FROM_THE_FUTURE: "event time ahead of the receipt by more than max_ahead_s, or of the sender's own clock",
    Outcome.DUPLICATE: "a message of this sender with this count and time was here before",
    Outcome.CONTRADICTION: "a message of this sender with this time and another content was here before",
    Outcome.OUT_OF_ORDER: "the message is not newer than the newest of this sender, and no copy of it",
    Outcome.DETECTOR_FAILED: "the detector failed on this message or on one beside it, which its log shows",
    Outcome.TABLE_FULL: "as many vehicles are known as vehicle_capacity allows",
}
"""Details of the reasons for which the core rejects a record."""

_ETSI_TARGET: Final = {
    Sensor.LOCATION: wire.EtsiTarget.POSITION,
    Sensor.SPEED: wire.EtsiTarget.SPEED,
    Sensor.BOTH: wire.EtsiTarget.POSITION,
    Sensor.LINK: wire.EtsiTarget.BEACON,
}


class Timing(NamedTuple):
    """When a batch was processed; durations in microseconds."""

    drained_us: int
    """Local time at which the batch left the queue."""
    clock_offset_us: int
    """Takes local time to Unix time."""
    decode_us: int
    detect_us: int

    @property
    def detected_us(self) -> int:
        """Unix time at which the detector was done."""
        return self.drained_us + self.clock_offset_us + self.decode_us + self.detect_us


def event_message(
    event: AnomalyEvent,
    identity: Identity,
    timing: Timing,
    messages: Callable[[str, int], tuple[wire.OriginalMessage, ...]] = lambda _suspect, _t_us: (),
) -> wire.Event:
    """Return what goes to the alert topic; the evidence, which is of the first reading, goes with the onset.

    `messages` returns the original messages of a suspect up to an event time.
    """
    evidence = None
    if event.evidence is not None and event.phase is Phase.ONSET:
        evidence = to_wire(event.evidence, identity, messages(event.suspect, event.t_us))
    latency_us = {
        wire.Stage.WIRE: event.received_us + timing.clock_offset_us - event.t_us,
        wire.Stage.DECODE: timing.decode_us,
        wire.Stage.DETECT: timing.detect_us,
    }
    if event.evidence is not None:
        latency_us[wire.Stage.QUEUE] = timing.drained_us - event.received_us
    x_m, v_mps, x_std_m, v_std_mps = event.recovered
    return wire.Event(
        event_id=event.event_id,
        phase=wire.Phase(event.phase),
        kind=wire.Kind(event.kind.label),
        sensor=wire.Sensor(event.sensor.label),
        suspect=event.suspect,
        leader=event.leader,
        follower=event.follower,
        site=identity.site,
        t_us=event.t_us,
        onset_us=event.onset_us,
        detected_us=timing.detected_us,
        nis=event.nis,
        statistic=event.statistic,
        gate=event.gate,
        p_value=event.p_value,
        innovation=wire.Innovation(x_m=event.nu[0], v_mps=event.nu[1]),
        recovered=wire.Recovered(x_m=x_m, v_mps=v_mps, x_std_m=x_std_m, v_std_mps=v_std_mps),
        deviation=wire.Deviation(x_m=event.deviation[0], v_mps=event.deviation[1]) if any(event.deviation) else None,
        latency_us=latency_us,
        model=identity.model,
        config_hash=identity.config_hash,
        confidence=event.confidence,
        observations=tuple(map(wire.Observation, event.observations)),
        etsi_target=_ETSI_TARGET.get(event.sensor),
        evidence=evidence,
    )


def state_messages(states: PairStates, site: str) -> Iterator[PairState]:
    """Yield the state of each vehicle."""
    columns = zip(
        states.followers,
        states.leaders,
        states.t_us.tolist(),
        _standings(states),
        *(getattr(states, name).tolist() for name in _STATE_NUMBERS),
        strict=True,
    )
    for follower, leader, t_us, standing, *numbers in columns:
        fields: dict[str, Any] = dict(zip(_STATE_NUMBERS.values(), numbers, strict=True))
        yield PairState(site=site, follower=follower, leader=leader, t_us=t_us, standing=standing, **fields)


def quality_messages(states: QualityStates, site: str) -> Iterator[SensorQuality]:
    """Yield the quality of the sensors of each vehicle."""
    names = [field.name for field in fields(states.qualities)]
    columns = zip(
        states.vehicles,
        states.t_us.tolist(),
        states.levels.tolist(),
        *(getattr(states.qualities, name).tolist() for name in names),
        strict=True,
    )
    for vehicle, t_us, level, *numbers in columns:
        found: dict[str, Any] = dict(zip(names, numbers, strict=True))
        yield SensorQuality(
            site=site, vehicle=vehicle, t_us=t_us, level=wire_state.QualityLevel(QualityLevel(level).label), **found
        )


_STATE_NUMBERS: Final = {
    "lat_deg": "lat",
    "lon_deg": "lon",
    "heading_deg": "heading_deg",
    "gap_m": "gap_m",
    "x_m": "x_m",
    "offset_m": "offset_m",
    "v_mps": "v_mps",
    "nis": "nis",
    "statistic": "statistic",
    "gate": "gate",
}
"""Numbers of a state: name in the core, name on the wire."""


def _standings(states: PairStates) -> Iterator[Standing]:
    for silent, anomalous, warming in zip(
        states.silent.tolist(), states.anomalous.tolist(), states.warming.tolist(), strict=True
    ):
        if silent:
            yield Standing.SILENT
        elif anomalous:
            yield Standing.ANOMALOUS
        else:
            yield Standing.WARMING if warming else Standing.NORMAL


_KEY_COPIED_MAX: Final = 256
"""Most characters of a key in a rejected copy."""


def encode(message: Message) -> bytes:
    """Return one of the service's own messages as JSON."""
    return message.model_dump_json().encode()


def rejected_copy(rejection: Rejection, *, payload_max_bytes: int) -> RejectedCopy:
    """Return what goes to the rejected topic: never more than `payload_max_bytes` of the payload."""
    message = rejection.message
    sender = message.key.rpartition("/")[2]
    return RejectedCopy(
        reason=rejection.reason.outcome.label,
        detail=rejection.reason.detail,
        key=_printable(message.key),
        sender=sender if is_id(sender) else None,
        encoding=_printable(message.encoding),
        size=len(message.payload),
        payload=message.payload[:payload_max_bytes],
        truncated=len(message.payload) > payload_max_bytes,
        received_us=message.received_us,
        count=rejection.count,
    )


def _printable(text: str) -> str:
    return text[:_KEY_COPIED_MAX].encode("ascii", "backslashreplace").decode("ascii")
