"""Options of zenoh for a client of the bus."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import zenoh

from headway.errors import UserError, zenoh_reason

_OPEN_TIMEOUT_MS: Final = 2_000


def client_configuration(
    connect: Sequence[str], file: Path | None, more: Sequence[tuple[str, Any]] = ()
) -> zenoh.Config:
    """Return what a session is opened with; a named endpoint overrides that of the file, and `more` all else.

    Raises
    ------
    UserError
        An endpoint or the file is invalid.
    """
    try:
        config = zenoh.Config() if file is None else zenoh.Config.from_file(file)
        for path, value in (*_options(connect), *more):
            config.insert_json5(path, json.dumps(value))
    except zenoh.ZError as error:
        raise UserError(f"{file or ', '.join(connect)}: {zenoh_reason(error)}") from None
    return config


def _options(connect: Sequence[str]) -> Iterator[tuple[str, Any]]:
    # A client takes the first endpoint that answers; a peer reaches each.
    yield "mode", "peer" if len(connect) > 1 else "client"
    yield "listen/endpoints", []
    yield "connect/exit_on_failure", len(connect) <= 1
    yield "connect/timeout_ms", _OPEN_TIMEOUT_MS
    yield "connect/retry", {"period_init_ms": 200, "period_max_ms": 1_000, "period_increase_factor": 2}
    yield "scouting/multicast/enabled", False
    yield "scouting/gossip/enabled", False
    yield "transport/shared_memory/enabled", False
    if connect:
        yield "connect/endpoints", list(connect)
