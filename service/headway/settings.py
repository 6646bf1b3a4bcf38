"""All settings of the service. No other module reads settings from files or the environment.

A setting has one name: `delay_s` in the TOML file is `HEADWAY_DELAY_S` in the environment, which wins. An unknown name
in either stops the start; nothing is ignored.
"""

import difflib
import hashlib
import json
import os
import re
import socket
import tomllib
from collections.abc import Callable, Collection, Container, Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from enum import StrEnum, unique
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, ValidationError, WithJsonSchema, model_validator
from pydantic_settings import BaseSettings, NoDecode, PydanticBaseSettingsSource, SettingsConfigDict

from headway.core.types.config import MODEL_NAMES, DetectorConfig
from headway.errors import UserError
from headway_schemas.keys import ID_PATTERN, sanitise_id

ENV_PREFIX = "HEADWAY_"


class SettingsError(UserError):
    """An invalid setting and what is allowed, in one line."""


@unique
class Origin(StrEnum):
    """Source of an effective value."""

    DEFAULT = "default"
    FILE = "file"
    ENVIRONMENT = "environment"
    OPTION = "option"


def _listed(value: object) -> object:
    """Split a list of the environment at commas and blanks."""
    return re.split(r"[,\s]+", value.strip(", \t\n")) if isinstance(value, str) and value.strip() else value or ()


def _state_dir() -> Path | None:
    """Return the state folder of the service or of its user, None if there is neither."""
    if "STATE_DIRECTORY" in os.environ:
        return Path(os.environ["STATE_DIRECTORY"].partition(":")[0])
    try:
        return Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state") / "headway"
    except RuntimeError:
        return None


def _runtime_dir() -> Path | None:
    """Return the folder in memory that systemd made for the service, None if there is none."""
    folder = os.environ.get("RUNTIME_DIRECTORY", "").partition(":")[0]
    return Path(folder) if folder else None


def _given(value: object) -> object:
    """Read empty text as None."""
    return None if value == "" else value


def _endpoint(value: str) -> str:
    """Refuse what zenoh would refuse later, in words of its own."""
    if not re.fullmatch(r"[a-z][a-z0-9-]*/[^\s\"',]+", value):
        raise ValueError("an endpoint is written like tcp/10.0.0.1:7447; commas separate several")
    return value


StateDir = Annotated[Path | None, BeforeValidator(_given)]
Endpoint = Annotated[str, AfterValidator(_endpoint)]
Endpoints = Annotated[tuple[Endpoint, ...], NoDecode, BeforeValidator(_listed)]


def _known_model(value: str) -> str:
    if value not in MODEL_NAMES:
        raise ValueError("no such motion model")
    return value


ModelName = Annotated[str, AfterValidator(_known_model), WithJsonSchema({"type": "string", "enum": MODEL_NAMES})]


def _setting(default: Any, description: str, unit: str = "", **bounds: Any) -> Any:
    return Field(default, description=description, json_schema_extra={"unit": unit} if unit else None, **bounds)


_DETECTOR: Final = {parameter.name: parameter for parameter in fields(DetectorConfig)}


def _of_detector(name: str, unit: str = "", **bounds: Any) -> Any:
    """Declare a parameter of the detector as a setting, with the default and the description that it has there."""
    return _setting(_DETECTOR[name].default, _DETECTOR[name].metadata["description"], unit, **bounds)


class Settings(BaseSettings):
    """All settings, frozen. Detection first, then the bus, intake, what is published, and the process."""

    model_config = SettingsConfigDict(env_prefix=ENV_PREFIX, frozen=True, extra="forbid", validate_default=True)

    model: ModelName = _of_detector("model")
    delay_s: float = _of_detector("delay_s", "s", ge=0, le=5)
    delay_jitter_s: float = _of_detector("delay_jitter_s", "s", ge=0, le=5)
    alarm_budget_per_hour: float = _of_detector("alarm_budget_per_hour", "1/h", gt=0, le=3600)
    vehicle_capacity: int = _of_detector("vehicle_capacity", ge=1, le=1_000_000)
    vehicle_ttl_s: float = _of_detector("vehicle_ttl_s", "s", gt=0, le=3600)
    max_age_s: float = _of_detector("max_age_s", "s", gt=0, le=3600)
    max_ahead_s: float = _of_detector("max_ahead_s", "s", gt=0, le=3600)
    max_gap_s: float = _of_detector("max_gap_s", "s", gt=0, le=60)
    warming_readings: int = _of_detector("warming_readings", ge=1, le=10_000)
    silence_timeout_s: float = _of_detector("silence_timeout_s", "s", ge=0.6, le=60)
    lane_width_m: float = _of_detector("lane_width_m", "m", gt=0, le=20)
    pairing_range_m: float = _of_detector("pairing_range_m", "m", gt=0, le=1000)
    evidence_readings: int = _of_detector("evidence_readings", ge=4, le=1000, multiple_of=4)

    workers: int = _setting(
        1, "Processes with an engine each; with more than one the site is shared out among them by cells.", ge=1, le=32
    )
    cell_m: float = _setting(
        2_000.0, "Side of a cell, with several workers; at least four times pairing_range_m.", "m", gt=0, le=1e6
    )

    site: str = _setting(
        "local", "Coverage of one roadside unit; a chunk of every key.", "", pattern=f"^(?:{ID_PATTERN})$"
    )
    prefix: str = _setting("v2x", "First chunks of every key.", "", pattern=f"^{ID_PATTERN}(?:/{ID_PATTERN})*$")
    instance: str = _setting(
        sanitise_id(socket.gethostname()),
        "Id of this process, unique within the site; by default the name of the host.",
        "",
        pattern=f"^(?:{ID_PATTERN})$",
    )
    epoch: int = _setting(0, "Rank of the service in a fleet: the highest of a site judges; 0: none.", ge=0, le=2**53)
    lease_s: float = _setting(1.0, "With an epoch: one not confirmed for so long ends the service.", "s", ge=0.2, le=60)
    mode: Literal["client", "peer", "router"] = _setting(
        "peer", "`client` joins a router, `peer` accepts clients, `router` also forwards between them."
    )
    connect: Endpoints = _setting((), "zenoh endpoints to connect to, such as tcp/10.0.0.1:7447.")
    listen: Endpoints = _setting(("tcp/127.0.0.1:7447",), "zenoh endpoints to listen on; a client does not listen.")
    handover: Annotated[Path | None, BeforeValidator(_given)] = _setting(
        None, "TOML file with the areas of neighbouring sites, to which vehicles go over with their state; one worker."
    )
    zenoh_config: Annotated[Path | None, BeforeValidator(_given)] = _setting(
        None, "JSON5 file of zenoh's own options (TLS, access control); mode and endpoints set here win over it."
    )
    connect_timeout_s: float = _setting(3.0, "Longest attempt to reach a router; attempts repeat.", "s", gt=0, le=60)
    block_timeout_s: float = _setting(
        0.5,
        "A subscriber that takes no alert for this long is disconnected; a router that takes none misses it.",
        "s",
        gt=0,
        le=600,
    )

    batch_limit: int = _setting(2_000, "Most messages of one loop iteration.", ge=1, le=100_000)
    batch_bytes_limit: int = _setting(256 << 10, "Most bytes of one loop iteration.", "B", ge=1024, le=1 << 28)
    queue_limit: int = _setting(50_000, "Most messages that wait; beyond it the oldest is shed.", ge=1, le=10_000_000)
    queue_bytes_limit: int = _setting(
        64 << 20, "Most bytes that wait; beyond it the oldest message is shed.", "B", ge=1 << 16, le=1 << 34
    )
    queue_age_limit_s: float = _setting(1.0, "A message that waited longer is shed as `stale`.", "s", ge=0.1, le=60)
    sender_rate_hz: int = _setting(
        100,
        "Most messages a second of one vehicle (a message above 4 kB counts as several); others are `rate_exceeded`.",
        "Hz",
        ge=1,
        le=1_000_000,
    )
    payload_bytes_limit: int = _setting(
        64 << 10, "A larger payload is rejected as `payload_too_large`.", "B", ge=64, le=1 << 26
    )
    bundle_limit: int = _setting(512, "A bundle of more records is rejected as `bundle_too_large`.", ge=1, le=65_536)
    idle_sleep_s: float = _setting(
        0.001,
        "Pause between loop iterations, in which a batch gathers; three times as long while few messages arrive.",
        "s",
        gt=0,
        le=0.1,
    )

    state_rate_hz: float = _setting(
        1.0, "States published of each vehicle per second; 0 publishes none.", "Hz", ge=0, le=10
    )
    state_budget_hz: float = _setting(
        1_000.0, "Most states published per second; beyond it each vehicle waits longer.", "Hz", gt=0, le=100_000
    )
    rejected_rate_hz: float = _setting(
        10.0, "Copies of rejected messages published per reason and second.", "Hz", ge=0, le=1e4
    )
    rejected_bytes_limit: int = _setting(
        1024, "Most bytes of payload in the copy of a rejected message.", "B", ge=0, le=1 << 16
    )
    health_interval_s: float = _setting(1.0, "Time between two health reports.", "s", ge=0.1, le=60)
    suspect_burst: int = _setting(
        5, "Events of one suspect published one by one; further ones are summarised in one event.", ge=1, le=10_000
    )
    suspect_refill_s: float = _setting(
        600.0, "Time after which a suspect may have one more event of its own.", "s", gt=0, le=86_400
    )
    history_mb: float = _setting(
        32.0, "Memory for original messages, of the last ten seconds at most; 0 keeps none.", "MB", ge=0, le=1e5
    )
    evidence_messages_bytes: int = _setting(
        8_192, "Most bytes of original messages of the suspect in the evidence of an event.", "B", ge=0, le=1 << 20
    )
    alert_queue_limit: int = _setting(
        10_000, "Most alerts that wait for a slow bus; beyond it the oldest is dropped and counted.", ge=1, le=1_000_000
    )

    state_dir: StateDir = Field(
        default_factory=_state_dir,
        description="Folder of the journal and the snapshot; empty stores nothing. By default $STATE_DIRECTORY, which"
        " systemd sets, or headway in $XDG_STATE_HOME or ~/.local/state.",
    )
    snapshot_dir: StateDir = Field(
        default_factory=_runtime_dir,
        description="Folder of the snapshot, best in memory: it is for a process that ends, not for a machine. By"
        " default $RUNTIME_DIRECTORY, which systemd sets, or state_dir.",
    )
    journal_days: float = _setting(
        30.0, "Event updates older than this are deleted from the journal.", "d", gt=0, le=3650
    )
    journal_mb: float = _setting(
        1_000.0, "Largest journal; beyond it the oldest event updates are deleted.", "MB", ge=1, le=1e6
    )
    snapshot_interval_s: float = _setting(
        1.0, "Time between two snapshots of the detector; one more follows at the end.", "s", ge=0.1, le=3600
    )

    http_host: str = _setting("127.0.0.1", "Address of /metrics, /livez and /readyz.")
    http_port: int = _setting(9464, "Port of these pages; 0 takes a free one.", ge=0, le=65_535)
    log_level: Literal["debug", "info", "warning", "error"] = _setting("info", "Least severity logged.")
    log_format: Literal["json", "console"] = _setting("json", "One JSON object a line, or lines for people.")
    stop_timeout_s: float = _setting(10.0, "Longest time after SIGTERM to process what is queued.", "s", gt=0, le=600)

    @model_validator(mode="after")
    def _cells_hold_their_halo(self) -> Self:
        if self.workers > 1 and self.handover is not None:
            raise ValueError("handover needs workers = 1")
        if self.workers > 1 and self.cell_m < 4.0 * self.pairing_range_m:
            raise ValueError("cell_m must be at least four times pairing_range_m")
        return self

    @model_validator(mode="after")
    def _reachable(self) -> Self:
        if self.mode == "client" and not self.connect and self.zenoh_config is None:
            raise ValueError("mode client needs an endpoint in connect, such as tcp/127.0.0.1:7447")
        if self.epoch and self.state_dir is None:
            raise ValueError("epoch needs state_dir, a folder that every service of the site reaches")
        return self

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,
        file_secret_settings: PydanticBaseSettingsSource,
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """Let the environment win over what `load` read from the file."""
        del settings_cls, dotenv_settings, file_secret_settings
        return env_settings, init_settings

    def detector(self) -> DetectorConfig:
        """Return the parameters of the detector."""
        return DetectorConfig(**{field.name: getattr(self, field.name) for field in fields(DetectorConfig)})

    @property
    def config_hash(self) -> str:
        """Twelve hexadecimal digits that differ when anything that changes a verdict differs."""
        return config_hash(self.detector())


def config_hash(config: DetectorConfig) -> str:
    """Return twelve hexadecimal digits that differ when anything that changes a verdict differs."""
    canonical = json.dumps(asdict(config), sort_keys=True)
    return hashlib.sha256(canonical.encode()).hexdigest()[:12]


class _Given(Settings):
    """The same settings from arguments alone: neither a file nor the environment is read."""

    @classmethod
    def settings_customise_sources(
        cls, settings_cls: type[BaseSettings], init_settings: PydanticBaseSettingsSource, *_: Any, **__: Any
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """Read the arguments only."""
        del settings_cls
        return (init_settings,)


@dataclass(frozen=True, slots=True)
class Loaded:
    """Effective settings and the source of each."""

    settings: Settings
    origins: Mapping[str, Origin]


def load(file: Path | None = None, options: Mapping[str, str] | None = None) -> Loaded:
    """Read the TOML `file`, then the environment over it, then `options`, the text of each value by its name.

    Raises
    ------
    SettingsError
        The file cannot be read, a name is unknown, or a value is not allowed.
    """
    in_file, options = _read(file) if file else {}, options or {}
    in_environment = {name[len(ENV_PREFIX) :].lower() for name in os.environ if name.upper().startswith(ENV_PREFIX)}
    _refuse_unknown(in_file, f" in {file}", str)
    _refuse_unknown(in_environment, " in the environment", _variable)
    _refuse_unknown(options, "", str)
    origins = {name: _origin(name, in_file, in_environment) for name in Settings.model_fields}
    origins |= dict.fromkeys(options, Origin.OPTION)
    try:
        settings = Settings(**in_file)
        return Loaded(_Given(**{**settings.model_dump(), **options}) if options else settings, origins)
    except ValidationError as error:
        raise SettingsError("; ".join(_describe(problem, origins) for problem in error.errors())) from None


def detector_config(values: Mapping[str, Any]) -> DetectorConfig:
    """Return the configuration with these parameters, and the default of each other one.

    Raises
    ------
    SettingsError
        A name is unknown, or a value is not allowed.
    """
    _refuse_unknown(values, "", str, _DETECTOR)
    try:
        return _Given(**values).detector()
    except ValidationError as error:
        origins = dict.fromkeys(Settings.model_fields, Origin.OPTION)
        raise SettingsError("; ".join(_describe(problem, origins) for problem in error.errors())) from None


def _read(file: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise SettingsError(f"{file}: {error.strerror or error}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SettingsError(f"{file}: not TOML: {error}") from None


def _variable(name: str) -> str:
    return ENV_PREFIX + name.upper()


def _origin(name: str, in_file: Container[str], in_environment: Container[str]) -> Origin:
    if name in in_environment:
        return Origin.ENVIRONMENT
    return Origin.FILE if name in in_file else Origin.DEFAULT


_RENAMED: Final = {"miss_after_s": "silence_timeout_s", "forget_after_s": "vehicle_ttl_s"}
"""Names of earlier versions, too different for a match by spelling."""


def _refuse_unknown(
    names: Iterable[str], place: str, spell: Callable[[str], str], known: Collection[str] = Settings.model_fields
) -> None:
    for name in sorted(names):
        if name not in known:
            nearest = [_RENAMED[name]] if name in _RENAMED else difflib.get_close_matches(name, known, n=1)
            hint = f"did you mean {spell(nearest[0])}?" if nearest else "`headway config show` lists the names"
            raise SettingsError(f"unknown setting {spell(name)}{place}: {hint}")


def _describe(problem: Any, origins: Mapping[str, Origin]) -> str:
    message = problem["msg"].removeprefix("Value error, ")
    if not problem["loc"]:
        return str(message)
    name = str(problem["loc"][0])
    shown = _variable(name) if origins[name] is Origin.ENVIRONMENT else name
    return f"{shown} = {problem['input']!r}: {message[:1].lower()}{message[1:]} (allowed: {allowed(name)})"


def allowed(name: str) -> str:
    """Describe in a few words which values a setting takes."""
    entry = Settings.model_json_schema()["properties"][name]
    if "enum" in entry:
        return ", ".join(entry["enum"])
    if "pattern" in entry:
        return f"text matching {entry['pattern']}"
    if entry.get("type") == "array":
        return "a list"
    if "maximum" not in entry:
        return str(entry.get("type", "path"))
    low = f"from {entry['minimum']}" if "minimum" in entry else f"above {entry['exclusiveMinimum']}"
    return f"{entry['type']} {low} to {entry['maximum']} {entry.get('unit', '')}".rstrip()
