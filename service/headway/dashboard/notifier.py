"""Sends notices to a webhook and to Alertmanager, one after another, and again where a receiver does not answer."""

import asyncio
import json
import sys
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final
from urllib.parse import urlsplit

from headway.dashboard.notices import Notice, Notices, alertmanager_body, webhook_body
from headway.dashboard.view_state import ViewState
from headway.errors import UserError

_EVERY_S: Final = 0.5
_TIMEOUT_S: Final = 10.0
_RETRY_S: Final = (1.0, 2.0, 5.0, 10.0, 30.0, 60.0, 60.0)
_WAITING_MAX: Final = 1_000
_TOO_MANY: Final = 429
_SERVER_ERROR: Final = 500


@dataclass(frozen=True, slots=True)
class Receivers:
    """Where notices go; None: nowhere.

    Raises
    ------
    UserError
        An address is not one of HTTP.
    """

    webhook: str | None = None
    alertmanager: str | None = None
    """Base address, such as http://127.0.0.1:9093."""
    runbook_url: str | None = None
    """What notices name as the place where a person reads what to do."""

    def __post_init__(self) -> None:
        for address in filter(None, (self.webhook, self.alertmanager, self.runbook_url)):
            parts = urlsplit(address)
            if parts.scheme not in {"http", "https"} or not parts.hostname:
                raise UserError(f"{address}: no address of HTTP; write it like http://127.0.0.1:9093")

    def requests(self, notice: Notice) -> Iterator[tuple[str, Any]]:
        """Yield address and body for each receiver."""
        if self.webhook is not None:
            yield self.webhook, webhook_body(notice, self.runbook_url)
        if self.alertmanager is not None:
            yield f"{self.alertmanager.rstrip('/')}/api/v2/alerts", alertmanager_body(notice, self.runbook_url)


class Notifier:
    """Watches a view state. A receiver that is slow or away holds up its own requests only."""

    def __init__(self, receivers: Receivers, view_state: ViewState, now_us: Callable[[], int]) -> None:
        self._receivers = receivers
        self._view_state = view_state
        self._now_us = now_us
        self._notices = Notices()
        self._queues: dict[str, asyncio.Queue[Any]] = {}

    async def run(self) -> None:
        """Send what is due until cancelled."""
        async with asyncio.TaskGroup() as tasks:
            while True:
                state, now_us = self._view_state, self._now_us()
                due = self._notices.update(state.events, state.handlings, state.reporting_sites(now_us), now_us)
                for notice in due:
                    for address, body in self._receivers.requests(notice):
                        if address not in self._queues:
                            self._queues[address] = asyncio.Queue()
                            tasks.create_task(self._send_all(address, self._queues[address]))
                        self._put(address, body)
                await asyncio.sleep(_EVERY_S)

    def _put(self, address: str, body: object) -> None:
        if self._queues[address].qsize() >= _WAITING_MAX:
            self._queues[address].get_nowait()
            _say(address, f"more than {_WAITING_MAX} notices wait; the oldest is dropped")
        self._queues[address].put_nowait(body)

    async def _send_all(self, address: str, queue: asyncio.Queue[Any]) -> None:
        while True:
            data = json.dumps(await queue.get()).encode()
            for wait_s in (*_RETRY_S, None):
                problem, is_final = await asyncio.to_thread(_post, address, data)
                if problem is None:
                    break
                if is_final or wait_s is None:
                    _say(address, f"a notice is not delivered: {problem}")
                    break
                await asyncio.sleep(wait_s)


def _post(address: str, data: bytes) -> tuple[str | None, bool]:
    """Send once; return the problem, if any, and whether another attempt is of no use."""
    request = urllib.request.Request(address, data, {"Content-Type": "application/json"})  # noqa: S310 - HTTP only
    try:
        with urllib.request.urlopen(request, timeout=_TIMEOUT_S):  # noqa: S310
            return None, True
    except urllib.error.HTTPError as error:
        error.close()
        return f"status {error.code}", error.code < _SERVER_ERROR and error.code != _TOO_MANY
    except OSError as error:
        return str(getattr(error, "reason", error)), False


def _say(address: str, what: str) -> None:
    sys.stderr.write(f"headway dashboard: {urlsplit(address).netloc.rpartition('@')[2]}: {what}\n")
    sys.stderr.flush()
