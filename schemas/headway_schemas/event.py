"""Event, version 1: a reading, or a silence, that car-following does not explain."""

from enum import IntEnum, StrEnum
from typing import Annotated

from pydantic import Field

from headway_schemas.fields import Blob, Id, Message, Number, Share, TUs

EventId = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.~-]{1,128}$")]
"""Longer than an identifier, because it may contain one."""


class Phase(StrEnum):
    """Phase of an event: the same `event_id` runs through all three."""

    ONSET = "onset"
    UPDATE = "update"
    CLEARED = "cleared"


class Kind(StrEnum):
    """What the anomaly looks like."""

    SHORT = "short"
    """One reading far off, the next ones right again."""
    NOISE = "noise"
    """Readings scatter more than the sensor should."""
    BIAS = "bias"
    """Readings are off by a constant."""
    DRIFT = "drift"
    """Readings move away steadily."""
    MISS = "miss"
    """Readings are absent for longer than the sender's own interval explains."""
    RESPONSE = "response"
    """Readings agree with each other, but not with the response of a driver to the leader."""
    RANGE = "range"
    """Declared positions contradict a forward range sensor."""
    UNKNOWN = "unknown"
    """Too early to say: an update follows."""


class Sensor(StrEnum):
    """Which reading is faulty."""

    LOCATION = "location"
    SPEED = "speed"
    BOTH = "both"
    LINK = "link"
    """The link between two vehicles or to one: not a sensor of its own."""
    HEADING = "heading"


class Observation(StrEnum):
    """A physical limit that messages break, whatever the detector has learnt of the vehicle."""

    POSITION_CHANGE = "position_change"
    """A step of the position that no car can make."""
    POSITION_FROZEN = "position_frozen"
    """The position stays the same while the speed is not zero."""
    POSITION_SPEED = "position_speed"
    """Displacement and speed contradict each other over one second or four."""
    SPEED_VALUE = "speed_value"
    """A speed that no car has."""
    SPEED_CHANGE = "speed_change"
    """A change of the speed that no car can make."""
    SPEED_FROZEN = "speed_frozen"
    """A speed that dithered before stands still while the car moves."""
    ACCELERATION = "acceleration"
    """Position and speed agree upon an acceleration that no car has."""
    HEADING = "heading"
    """The heading contradicts the course, or turns faster than a car."""
    INTERVAL = "interval"
    """Messages follow each other faster than any standard allows."""
    IDENTITY = "identity"
    """The position goes back and forth between two places: two senders with one id."""
    CONTRADICTION = "contradiction"
    """Two messages of one id and one time differ, or one is from where the vehicle was not."""
    JERK = "jerk"
    """The acceleration changes faster than in any car."""
    OVERLAP = "overlap"
    """The vehicle drives in the place of another one, which was there before."""
    APPEARANCE = "appearance"
    """The vehicle was first received in motion, in the middle of observed road."""


class EtsiTarget(IntEnum):
    """Target of the misbehaviour, ETSI TS 103 759."""

    BEACON = 0
    STATIC = 1
    SECURITY = 2
    POSITION = 3
    SPEED = 4
    LONGITUDINAL_ACCELERATION = 5


class Stage(StrEnum):
    """Stages on the way of a message, in order."""

    WIRE = "wire"
    """From the reading's event time to its receipt: two clocks, so it may be negative."""
    QUEUE = "queue"
    DECODE = "decode"
    DETECT = "detect"


class Innovation(Message):
    """Reading less prediction."""

    x_m: Number
    v_mps: Number


class Recovered(Message):
    """The estimate in place of the reading, with one sigma of each."""

    x_m: Number
    v_mps: Number
    x_std_m: Number
    v_std_mps: Number


class Deviation(Message):
    """Largest absolute difference between reading and estimate, over the readings of an event until now."""

    x_m: Number
    v_mps: Number


class OriginalMessage(Message):
    """A message as it was received."""

    received_us: TUs
    encoding: str
    payload: Blob
    """The octets as the sender or the gateway received them; a record of a bundle is encoded again by itself."""


class Evidence(Message):
    """The readings around the verdict, enough to replay it: a table that names its own columns."""

    columns: Annotated[tuple[str, ...], Field(strict=False)]
    readings: Annotated[tuple[Annotated[tuple[Number, ...], Field(strict=False)], ...], Field(strict=False)]
    """One row per reading, oldest first, the scored one last; values in the order of `columns`."""
    messages: Annotated[tuple[OriginalMessage, ...], Field(strict=False)] = ()
    """Newest messages of the suspect up to the reading, oldest first, as far as the service still had them."""
    checkpoint: Blob | None = None
    """The pair's row of the bank before the first of the readings."""
    parameters: Annotated[dict[str, Number | str], Field(default_factory=dict)]
    """All that the verdict depends on except the readings: settings of the detector, `version`, and `core`, a digest of
    the sources of the core."""


class Event(Message):
    """One update of an anomaly: onset, update or end."""

    event_id: EventId
    phase: Phase
    kind: Kind
    sensor: Sensor
    suspect: Id
    """The vehicle whose reading is faulty."""
    leader: Id | None = None
    """Null on a free road."""
    follower: Id
    site: Id
    t_us: TUs
    """Event time of the reading."""
    detected_us: TUs
    onset_us: TUs | None = None
    """Event time of the reading with which the event began."""
    nis: Number = None
    """Normalised innovation squared."""
    statistic: Number = None
    """What is compared with the gate: `nis`, or a running statistic of it."""
    gate: Number = None
    """Threshold of the statistic; an event starts when the statistic exceeds it."""
    p_value: Number = None
    innovation: Innovation | None = None
    recovered: Recovered | None = None
    deviation: Deviation | None = None
    """Null where no reading of the suspect deviates: a miss, or an event of the link."""
    latency_us: Annotated[dict[Stage, int], Field(default_factory=dict)]
    model: str
    config_hash: str
    instance: Id | None = None
    """The publisher. With `sequence` it names this update."""
    sequence: Annotated[int, Field(ge=1)] | None = None
    """Counts the updates of an instance without a gap; a subscriber that sees a gap asks the history."""
    epoch: Annotated[int, Field(ge=1)] | None = None
    """Number of the publisher among the services of its site; a higher one replaces it. Null outside a fleet."""
    count: Annotated[int, Field(ge=1)] = 1
    """Anomalies that this event stands for; above 1 where a suspect has so many that they are summarised."""
    confidence: Share = None
    """Probability of the diagnosed kind and sensor."""
    etsi_target: EtsiTarget | None = None
    observations: Annotated[tuple[Observation, ...], Field(strict=False)] = ()
    """Physical limits that the suspect's messages break at this statement."""
    evidence: Evidence | None = None
