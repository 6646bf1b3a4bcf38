"""The detector as a library: records in, verdicts and events out, without a bus or a clock.

It is the engine and the codec of the service. Time is what the records say: it passes up to the newest `received_us`.
"""

import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Final

import numpy as np
from numba.core import event as numba_event
from numpy.typing import NDArray

from headway import kernel_cache
from headway.core.engine import Engine
from headway.core.types.identifiers import ID
from headway.core.types.outcome import Outcome
from headway.core.types.records import Kind, Sensor
from headway.core.types.step_result import AnomalyEvent, RecordVerdicts
from headway.edge.codec.decoded import DecodedRecords
from headway.edge.codec.decoder import Codec
from headway.edge.codec.evidence import parameters
from headway.edge.codec.messages import Timing, event_message, quality_messages
from headway.edge.codec.payload import record_of
from headway.edge.identity import Identity
from headway.gateways.recordings.columns import RECEIVED, columns_of, records_of
from headway.result import VERDICTS, Readings, Result
from headway.settings import config_hash, detector_config
from headway.version import version
from headway_schemas.event import Event, Stage
from headway_schemas.fields import T_US_MAX
from headway_schemas.keys import Keys
from headway_schemas.state import SensorQuality

_PREFIX: Final = "v2x"
_OUTCOMES: Final = np.array([Outcome(n).label if n in list(Outcome) else "" for n in range(max(Outcome) + 1)])
_SENSORS: Final = np.array([sensor.label if sensor else "" for sensor in Sensor])
_KINDS: Final = np.array([kind.label if kind else "" for kind in Kind])
_NUMBERS: Final = ("statistic", "gate", "p_value", "x_m", "v_mps")
_PLAIN: Final = {int, float, str, dict, type(None)}


class ReceivedError(ValueError):
    """The time of reception of a record is no time."""

    def __init__(self, place: int, value: object) -> None:
        self.place = place
        self.problem = f"received_us is {value!r}, not microseconds of Unix time"
        super().__init__(f"record {place}: {self.problem}")


class Detector:
    """Detects anomalies in records of any number of vehicles that share a road.

    Parameters
    ----------
    site
        What events carry as their site.
    settings
        Any parameter of the detector by its name, such as `alarm_budget_per_hour` (1/h) or `delay_s` (s).

    Raises
    ------
    headway.errors.UserError
        A parameter is unknown or its value is not allowed.

    Examples
    --------
    >>> detector = Detector(alarm_budget_per_hour=1.0)
    >>> record = {"v": 1, "id": "car", "msg_cnt": 0, "t_us": 1_700_000_000_000_000, "lat": 42.3, "lon": -83.7}
    >>> result = detector.process([record | {"speed_mps": 14.2}, record | {"speed_mps": 999.0}])
    >>> result.verdicts["outcome"].tolist()
    ['warming', 'out_of_range']
    >>> result.problems
    {1: 'speed_mps: Input should be less than or equal to 163.8'}
    >>> detector.finish().events
    []
    """

    def __init__(self, *, site: str = "local", **settings: float | str) -> None:
        config = detector_config(settings)
        self._codec = Codec(Keys(_PREFIX, site))
        self._engine = Engine(config)
        self._identity = Identity(
            site=site,
            instance="detector",
            version=version(),
            model=config.model,
            config_hash=config_hash(config),
            parameters=parameters(config, version(), kernel_cache.core_digest()),
        )
        self._ttl_us = int(1e6 * config.vehicle_ttl_s)
        with kernel_cache.alone(), _compilation_message():
            self._engine.warm_up()

    def process(self, chunk: Any) -> Result:
        """Judge records in the order of their reception.

        Parameters
        ----------
        chunk
            A polars, pandas or Arrow table, a mapping of columns, or a list of records, with the names of BSM v1.
            `received_us` (microseconds of Unix time) may say when each was received; otherwise it is `t_us`.

        Returns
        -------
        Result
            A verdict for each record, also for those that are rejected, and the events that they caused.

        Raises
        ------
        TypeError
            The chunk is none of these.
        ValueError
            A column of a table is unknown or missing, or `received_us` is no time.
        """
        records = chunk if isinstance(chunk, list | tuple) else records_of(columns_of(chunk))
        received_us = [_received_us(i, record) for i, record in enumerate(records)]
        decoded = self._codec.decode_records([_compact(record) for record in records], received_us)
        found = RecordVerdicts.empty(len(decoded.batch))
        stepped = self._engine.step(decoded.batch, out=found)
        return _result(len(records), decoded, found, stepped.outcomes, self._events(stepped.events))

    def finish(self) -> Result:
        """Let time pass until every event has ended, and every vehicle is evicted; returns those last events."""
        nothing, found = self._codec.decode_records([], []), RecordVerdicts.empty(0)
        stepped = self._engine.step(nothing.batch, self._engine.now_us + 2 * self._ttl_us)
        return _result(0, nothing, found, stepped.outcomes, self._events(stepped.events))

    def qualities(self) -> list[SensorQuality]:
        """Return what is known of the sensors of each vehicle that is not evicted yet, as on the wire."""
        states = self._engine.qualities()
        return [] if states is None else list(quality_messages(states, self._identity.site))

    def _events(self, events: Iterable[AnomalyEvent]) -> list[Event]:
        """Return the events as on the wire; of the latencies there is only the one that the records themselves tell."""
        made = []
        for event in events:
            message = event_message(event, self._identity, Timing(event.detected_us, 0, 0, 0))
            latency_us = {Stage.WIRE: message.latency_us[Stage.WIRE]}
            made.append(message.model_copy(update={"latency_us": latency_us}))
        return made


def _received_us(place: int, record: Mapping[str, Any]) -> int | None:
    value = record.get(RECEIVED) if isinstance(record, Mapping) else None
    if value is None:
        return None
    if isinstance(value, int | np.integer) and 0 <= value <= T_US_MAX:
        return int(value)
    raise ReceivedError(place, value)


def _compact(record: Any) -> Any:
    """Return the compact record of a map without its time of reception; anything else as it is."""
    if not isinstance(record, Mapping):
        return record
    fields = {name: value for name, value in record.items() if name != RECEIVED}
    if not _PLAIN.issuperset(map(type, fields.values())):
        fields = {name: value.item() if isinstance(value, np.generic) else value for name, value in fields.items()}
    return record_of(fields)


def _result(
    count: int, decoded: DecodedRecords, found: RecordVerdicts, outcomes: NDArray[np.uint8], events: list[Event]
) -> Result:
    """Put what was found of the valid records beside the reasons of the others."""
    verdicts = np.zeros(count, VERDICTS)
    ids, t_us = np.zeros(count, ID), np.zeros(count, np.int64)
    x_m, v_mps = np.full(count, np.nan), np.full(count, np.nan)
    for name in _NUMBERS:
        verdicts[name] = np.nan
    for place, reason in decoded.reasons:
        verdicts["outcome"][place] = reason.outcome.label
    verdicts["outcome"][decoded.places] = _OUTCOMES[outcomes]
    judged = np.flatnonzero(outcomes <= Outcome.WARMING)
    places, verdict, reading = decoded.places[judged], found.verdicts[judged], found.readings[judged]
    for name in ("anomalous", *_NUMBERS):
        verdicts[name][places] = verdict[name]
    verdicts["sensor"][places] = _SENSORS[verdict["sensor"]]
    verdicts["kind"][places] = _KINDS[verdict["kind"]]
    verdicts["leader"][places] = found.leader_ids[judged].astype("U64")
    ids[places], t_us[places] = decoded.batch.ids[judged], decoded.batch.t_us[judged]
    x_m[places], v_mps[places] = reading["x_m"], reading["v_mps"]
    problems = {place: reason.detail for place, reason in decoded.reasons}
    return Result(events=events, verdicts=verdicts, problems=problems, readings=Readings(ids, t_us, x_m, v_mps))


@contextmanager
def _compilation_message() -> Iterator[None]:
    """Say once on standard error that kernels are compiled, where none are stored."""
    listener = _Announcement()
    numba_event.register("numba:compile", listener)  # type: ignore[no-untyped-call]
    try:
        yield
    finally:
        numba_event.unregister("numba:compile", listener)  # type: ignore[no-untyped-call]


class _Announcement(numba_event.Listener):
    def __init__(self) -> None:
        self._made = False

    def on_start(self, event: object) -> None:
        del event
        if not self._made:
            self._made = True
            sys.stderr.write("headway: compiling its kernels, for a minute or two; the next start loads them\n")

    def on_end(self, event: object) -> None:
        """Ignore it."""
