"""The file of a fleet: its sites, the settings of their services, and the folder that all machines reach."""

import hashlib
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError

from headway.errors import UserError, first_problem
from headway.settings import ENV_PREFIX, load
from headway_schemas.keys import ID_PATTERN

Value = bool | int | float | str | list[str]
Site = Annotated[str, StringConstraints(pattern=f"^(?:{ID_PATTERN})$")]

_OWN: Final = ("epoch", "site", "state_dir", "snapshot_dir")
"""Settings that the fleet gives to each service."""


class FleetConfig(BaseModel):
    """What runs where it can: the wanted state."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    state_dir: Path
    """Each site has a folder in it; every machine reaches it under this path."""
    cpus: float = Field(default=1.0, gt=0.0)
    """Processors that Ray reserves for a site."""
    spares: int = Field(default=1, ge=0, le=16)
    """Idle hosts on each machine, so that a failed site need not wait for one to start."""
    settings: dict[str, Value] = {}
    """Of every service, by the names of `headway serve`."""
    sites: dict[Site, dict[str, Value]] = {}
    """Settings of each site, over those of all."""


@dataclass(frozen=True, slots=True)
class BusOptions:
    """Where the controller watches the services."""

    prefix: str
    connect: tuple[str, ...]
    zenoh_config: Path | None


def read_config(file: Path, more_sites: Iterable[str] = (), *, may_be_empty: bool = False) -> FleetConfig:
    """Read the file, and add sites.

    Raises
    ------
    UserError
        It cannot be read, is wrong, or has no site.
    """
    try:
        given = tomllib.loads(file.read_text(encoding="utf-8"))
        sites = {site: {} for site in more_sites} | given.get("sites", {})
        config = FleetConfig.model_validate(given | {"sites": sites})
    except ValidationError as error:
        raise UserError(f"{file}: {first_problem(error)}") from None
    except OSError as error:
        raise UserError(f"{file}: {error.strerror}") from None
    except (ValueError, TypeError) as error:
        raise UserError(f"{file}: not the TOML of a fleet: {error}") from None
    if not config.sites and not may_be_empty:
        raise UserError(f"{file}: no site; add a table such as [sites.crossing-1], or use --discover-s")
    if not config.state_dir.is_absolute():
        raise UserError(f"{file}: state_dir {config.state_dir}: give a path that starts with /")
    for site in config.sites:
        check_settings(config, site)
    bus_options(config)
    return config


def check_settings(config: FleetConfig, site: str) -> None:
    """Raise `UserError` where a name of a site's settings is unknown, or a value is not allowed."""
    try:
        load(None, texts_of(config, site, epoch=1))
    except UserError as error:
        raise UserError(f"site {site}: {error}") from None


def texts_of(config: FleetConfig, site: str, epoch: int) -> dict[str, str]:
    """Return the settings of a site as text, by their names. Raises `UserError` for one that the fleet gives."""
    given = config.settings | config.sites[site]
    own = [name for name in _OWN if name in given]
    if own:
        raise UserError(f"setting {own[0]}: the fleet gives it to each service; leave it out")
    folder = config.state_dir / site
    defaults: dict[str, Value] = {"mode": "client", "instance": site, "http_port": 0}
    fixed: dict[str, Value] = {"site": site, "epoch": epoch, "state_dir": str(folder), "snapshot_dir": str(folder)}
    return {name: _text(value) for name, value in (defaults | given | fixed).items()}


def environment_of(config: FleetConfig, site: str, epoch: int) -> dict[str, str]:
    """Return the environment of the service of a site."""
    return {ENV_PREFIX + name.upper(): text for name, text in texts_of(config, site, epoch).items()}


def revision_of(config: FleetConfig, site: str, release: str) -> str:
    """Return what differs when the service of a site has to be replaced: by its settings, or by its `release`."""
    texts = sorted(texts_of(config, site, 0).items())
    return hashlib.sha256(repr((texts, release)).encode()).hexdigest()[:12]


def bus_options(config: FleetConfig) -> BusOptions:
    """Return where the bus is.

    Raises
    ------
    UserError
        `settings` does not say, or is wrong.
    """
    if not config.settings.keys() & {"connect", "zenoh_config"}:
        raise UserError('settings: connect is missing; name a router, such as connect = ["tcp/10.0.0.1:7447"]')
    settings = load(None, {name: _text(value) for name, value in config.settings.items()}).settings
    return BusOptions(settings.prefix, settings.connect, settings.zenoh_config)


def _text(value: Value) -> str:
    return ",".join(value) if isinstance(value, list) else str(value)


def epoch_file(state_dir: Path, site: str) -> Path:
    """Return the file with the highest epoch of a site, as the service names it."""
    return state_dir / site / f"{site}.epoch"
