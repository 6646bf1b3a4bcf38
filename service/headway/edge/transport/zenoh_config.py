"""The configuration of the zenoh session: settings of the service over zenoh's own."""

import json
from dataclasses import dataclass
from typing import Any, Final

import zenoh

from headway.errors import UserError, zenoh_reason

_MESSAGE_BYTES_MAX: Final = 1 << 24
"""zenoh drops larger messages, which bounds the memory that a sender can claim."""

_CONGESTION: Final = "transport/link/tx/queue/congestion_control"


class BusError(UserError):
    """zenoh refuses its configuration."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BusConfig:
    """How to join the bus.

    `options` is zenoh's own configuration (JSON5); it applies where `mode`, `connect` or `listen` is None.
    """

    instance: str
    mode: str | None
    connect: tuple[str, ...] | None
    listen: tuple[str, ...] | None
    options: str | None
    connect_timeout_s: float
    block_timeout_s: float
    alert_limit: int
    payload_max_bytes: int
    """Of a larger payload only the beginning is kept."""
    lease_s: float | None = None
    """A peer that hangs this long is gone; None: zenoh's own."""
    history: bool = False
    """Whether the service answers queries for the history of events."""
    handover: bool = False
    """Whether the service takes up vehicles from other sites."""

    def zenoh_config(self) -> zenoh.Config:
        """Return the configuration for zenoh. Raises `BusError`."""
        try:
            config = zenoh.Config.from_json5(self.options) if self.options else zenoh.Config()
            for key, value in self._inserted():
                config.insert_json5(key, json.dumps(value))
            if is_client(config):
                for wait in ("wait_before_drop", "max_wait_before_drop_fragments"):
                    config.insert_json5(f"{_CONGESTION}/drop/{wait}", json.dumps(self._block_us))
        except zenoh.ZError as error:
            raise BusError(f"zenoh options: {zenoh_reason(error)}") from None
        return config

    @property
    def _block_us(self) -> int:
        return int(self.block_timeout_s * 1e6)

    def _inserted(self) -> list[tuple[str, Any]]:
        inserted: list[tuple[str, Any]] = [
            ("transport/shared_memory/enabled", False),
            ("transport/link/rx/max_message_size", _MESSAGE_BYTES_MAX),
            (f"{_CONGESTION}/block/wait_before_close", self._block_us),
            ("connect/retry", {"period_init_ms": 200, "period_max_ms": 2_000, "period_increase_factor": 2}),
        ]
        if self.options is None:
            inserted += [("scouting/multicast/enabled", False), ("scouting/gossip/enabled", False)]
        if self.lease_s is not None:
            inserted.append(("transport/link/tx/lease", int(self.lease_s * 1e3)))
        if self.mode is not None:
            inserted.append(("mode", self.mode))
        if self.mode == "client":
            inserted.append(("connect/timeout_ms", int(self.connect_timeout_s * 1e3)))
        if self.connect is not None:
            inserted.append(("connect/endpoints", list(self.connect)))
        if self.listen is not None:
            inserted.append(("listen/endpoints", [] if self.mode == "client" else list(self.listen)))
        return inserted


def is_client(config: zenoh.Config) -> bool:
    """Whether a session of this configuration joins a router."""
    return bool(json.loads(config.get_json("mode")) == "client")
