"""What receivers are told of faulty vehicles: one notice when the first event begins, one when the last has ended."""

from collections.abc import Container, Iterable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any, Final

from headway.dashboard.event_summary import EventSummary
from headway_schemas import Phase
from headway_schemas.handling import Action, Handling

Body = dict[str, Any]

LAPSE_US: Final = 60_000_000
"""An event without an update for longer is over."""
QUIET_US: Final = 15_000_000
"""Without an open event for this long the matter is over: a fault that comes and goes is one."""
_NEVER_US: Final = 7 * 86_400_000_000
"""End of an alert that is open, for Alertmanager: a dashboard that dies leaves none open for longer."""


@dataclass(frozen=True, slots=True)
class Notice:
    """A vehicle of a site is faulty (`until_us` is None), or no longer."""

    site: str
    vehicle: str
    summary: EventSummary
    """The event with which it began, as it is known now."""
    since_us: int
    until_us: int | None = None


class Notices:
    """Which vehicles the receivers know to be faulty."""

    def __init__(self) -> None:
        self._firing: dict[tuple[str, str], Notice] = {}
        self._seen_us: dict[tuple[str, str], int] = {}
        """When each of them had an open event last."""

    def update(
        self, events: Iterable[EventSummary], handlings: Iterable[Handling], sites: Container[str], now_us: int
    ) -> list[Notice]:
        """Return the notices that are due. A muted vehicle has none, except the end of what was notified before.

        `sites` are those that report. Of another one nothing is known, so nothing there ends.
        """
        mutes = {(one.site, one.vehicle): one for one in handlings if one.action is Action.MUTE}
        due = []
        for event in events:
            newest = event.newest
            key = (newest.site, newest.suspect)
            is_lapsed = now_us - newest.detected_us >= LAPSE_US
            if newest.phase is Phase.CLEARED or (is_lapsed and (newest.site in sites or key not in self._firing)):
                continue
            self._seen_us[key] = now_us
            mute = mutes.get(key)
            is_muted = mute is not None and mute.is_in_force(onset_us=event.first_us, is_open=True, now_us=now_us)
            if key not in self._firing and not is_muted:
                self._firing[key] = Notice(*key, event, event.first_us)
                due.append(self._firing[key])
        over = [key for key, seen_us in self._seen_us.items() if now_us - seen_us >= QUIET_US]
        return due + [notice for key in over if (notice := self._end(key)) is not None]

    def _end(self, key: tuple[str, str]) -> Notice | None:
        until_us, notice = self._seen_us.pop(key), self._firing.pop(key, None)
        return None if notice is None else replace(notice, until_us=until_us)


def webhook_body(notice: Notice, runbook_url: str | None) -> Body:
    """Return the JSON of a webhook."""
    row = notice.summary.row()
    return {
        "status": "firing" if notice.until_us is None else "resolved",
        "site": notice.site,
        "vehicle": notice.vehicle,
        "since": _time(notice.since_us),
        "until": None if notice.until_us is None else _time(notice.until_us),
        "text": _text(notice),
        "runbook_url": runbook_url,
        **{name: row[name] for name in ("event_id", "kind", "sensor", "deviation_m", "deviation_mps", "p_value")},
    }


def alertmanager_body(notice: Notice, runbook_url: str | None) -> list[Body]:
    """Return the JSON of `POST /api/v2/alerts`."""
    labels = {"site": notice.site, "vehicle": notice.vehicle, "severity": "warning"}
    annotations = {"summary": _text(notice), "runbook_url": runbook_url or ""}
    return [
        {
            "labels": {"alertname": "HeadwayVehicleFaulty", **labels},
            "annotations": {name: text for name, text in annotations.items() if text},
            "startsAt": _time(notice.since_us),
            "endsAt": _time(notice.since_us + _NEVER_US if notice.until_us is None else notice.until_us),
        }
    ]


def _text(notice: Notice) -> str:
    newest = notice.summary.newest
    state = "is not to be trusted" if notice.until_us is None else "has no open alert any more"
    return f"{notice.vehicle} at {notice.site} {state}: {newest.kind}, {newest.sensor}"


def _time(us: int) -> str:
    return datetime.fromtimestamp(us / 1e6, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
