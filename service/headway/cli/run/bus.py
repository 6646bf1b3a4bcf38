"""Where a command finds the bus: where its options say, else where the settings put the service of this machine."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from headway.errors import UserError
from headway.settings import Loaded, Origin, load

_ANY_ADDRESS: Final = re.compile(r"(?<=/)(0\.0\.0\.0|\[::\])(?=:)")
_LOOPBACK: Final = {"0.0.0.0": "127.0.0.1", "[::]": "[::1]"}  # noqa: S104


@dataclass(frozen=True, slots=True)
class BusAccess:
    """What a client of the bus must know."""

    endpoints: tuple[str, ...]
    """Where to connect; empty where `zenoh_config` says it."""
    prefix: str
    site: str
    """Of the service of this machine."""
    zenoh_config: Path | None


def bus_access(
    config: Path | None, connect: Sequence[str] | None = None, zenoh_config: Path | None = None
) -> BusAccess:
    """Return where the options say; else where the service with the settings of `config` and HEADWAY_* is found.

    Raises
    ------
    SettingsError
        The settings are wrong.
    """
    loaded = load(config)
    settings = loaded.settings
    return BusAccess(
        endpoints=tuple(connect) if connect else () if zenoh_config else _endpoints(loaded),
        prefix=settings.prefix,
        site=settings.site,
        zenoh_config=zenoh_config or settings.zenoh_config,
    )


def only(connect: Sequence[str] | None) -> str | None:
    """Return the endpoint of a command that can use one.

    Raises
    ------
    UserError
        There are several.
    """
    if connect and len(connect) > 1:
        raise UserError(f"--connect {' --connect '.join(connect)}: this command connects to one endpoint")
    return connect[0] if connect else None


def _endpoints(loaded: Loaded) -> tuple[str, ...]:
    settings = loaded.settings
    in_file = all(loaded.origins[name] is Origin.DEFAULT for name in ("connect", "listen"))
    if settings.zenoh_config is not None and in_file:
        return ()
    return settings.connect or tuple(map(_reachable, settings.listen[:1]))


def _reachable(listen: str) -> str:
    """Return where a client of this machine reaches what listens there: every address is also the loopback's."""
    return _ANY_ADDRESS.sub(lambda found: _LOOPBACK[found[0]], listen)
