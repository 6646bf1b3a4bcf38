"""The web application: the page and its requests."""

import asyncio
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pydantic import ValidationError
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp

from headway.dashboard.access import WRITABLE, AccessControl
from headway.dashboard.basemap import Basemap
from headway.dashboard.broadcast import Broadcaster
from headway.dashboard.sse import EventStream
from headway.dashboard.view_state import Row, update_row
from headway.errors import first_problem
from headway_schemas import Event
from headway_schemas.fields import Id
from headway_schemas.handling import HandlingRequest
from headway_schemas.query import AlertsQuery

Explain = Callable[[Sequence[Event]], Row]
"""Computes the updates of an event again; returns what `headway explain --json` says, with the estimates."""


@dataclass(frozen=True, slots=True)
class Features:
    """What a page has beside the state of its sites."""

    explain: Explain | None = None
    basemap: Basemap | None = None


NO_FEATURES: Final = Features()
VIEWER_LIMIT: Final = 64
EVIDENCE_FIRST: Final = 2
EVIDENCE_LAST: Final = 8
"""A long event is shown with the evidence of its first and its last updates."""
_SHOWN_IN_FULL: Final = {"evidence": {"checkpoint", "parameters", "messages"}}
_SHOWN_BRIEFLY: Final = {"evidence"}
_REVISION_DIGITS: Final = 20
_EVENT_ID: Final = re.compile(r"[A-Za-z0-9_.~-]{1,128}")
_REQUEST_BYTES_MAX: Final = 4_096
_STATIC: Final = Path(__file__).with_name("static")


def create_app(
    broadcaster: Broadcaster,
    *,
    host: str = "127.0.0.1",
    token: str | None = None,
    names: Iterable[str] = (),
    features: Features = NO_FEATURES,
) -> Starlette:
    """Return the application that shows the state of a broadcaster."""
    page = _Page(broadcaster, features)
    return Starlette(
        routes=[
            Route("/", page.index),
            Route("/stream", page.stream),
            Route("/history", page.history),
            Route("/basemap", page.basemap),
            Route("/basemap/{z:int}/{x:int}/{y:int}", page.tile),
            Route("/event/{event_id}", page.event),
            Route("/event/{event_id}/explanation", page.explanation),
            Route(WRITABLE, page.handle, methods=["POST"]),
            Mount("/static", StaticFiles(directory=_STATIC)),
        ],
        middleware=[Middleware(AccessControl, host=host, token=token, names=names)],
    )


class _Page:
    """Answers from one broadcaster."""

    def __init__(self, broadcaster: Broadcaster, features: Features) -> None:
        self._broadcaster = broadcaster
        self._explain = features.explain
        self._basemap = features.basemap
        self._explaining = asyncio.Lock()

    async def index(self, _: Request) -> Response:
        return FileResponse(_STATIC / "index.html")

    async def stream(self, request: Request) -> ASGIApp:
        if self._broadcaster.viewers >= VIEWER_LIMIT:
            return PlainTextResponse(f"{VIEWER_LIMIT} viewers are the most\n", 503)
        last = request.headers.get("last-event-id", "")[:_REVISION_DIGITS]
        return EventStream(self._broadcaster, int(last) if last.isascii() and last.isdigit() else 0)

    async def history(self, request: Request) -> Response:
        parameters = dict(request.query_params)
        sites = self._sites(parameters.pop("site", None))
        if not sites:
            return PlainTextResponse(f"site: one of {', '.join(self._broadcaster.sites)}\n", 400)
        try:
            query = AlertsQuery.from_parameters(parameters)
        except ValidationError as error:
            return PlainTextResponse(f"{first_problem(error)}\n", 400)
        found = await self._broadcaster.history(sites, query)
        rows = self._events(found.events) if query.newest else list(map(update_row, found.events))
        oldest_us = found.events[-1].detected_us if len(found.events) >= query.limit else None
        return JSONResponse(
            {
                "events" if query.newest else "updates": rows,
                "before_us": oldest_us,
                "answers": found.answers,
                "problems": found.problems,
            }
        )

    def _events(self, newest_first: list[Event]) -> list[Row]:
        """Return one row for each event: journals of one site may each hold some of its updates."""
        newest: dict[tuple[str, str], Event] = {}
        for event in newest_first:
            newest.setdefault((event.site, event.event_id), event)
        return [self._broadcaster.summary(event).row() for event in newest.values()]

    def _sites(self, site: str | None) -> tuple[str, ...]:
        """Return the sites that are asked for; none where there is no such site."""
        return self._broadcaster.sites if site is None else tuple({site} & set(self._broadcaster.sites))

    async def _updates(self, request: Request) -> list[Event]:
        event_id = request.path_params["event_id"]
        sites = self._sites(request.query_params.get("site"))
        return await self._broadcaster.event(event_id, sites) if _EVENT_ID.fullmatch(event_id) else []

    async def event(self, request: Request) -> Response:
        updates = await self._updates(request)
        if not updates:
            return PlainTextResponse("no such event\n", 404)
        return JSONResponse(
            [
                event.model_dump(mode="json", exclude=_SHOWN_BRIEFLY if brief else _SHOWN_IN_FULL)
                for event, brief in zip(updates, _brief(len(updates)), strict=True)
            ]
        )

    async def explanation(self, request: Request) -> Response:
        """Return what the event's evidence says when it is computed again; null where there is none."""
        with_evidence = [update for update in await self._updates(request) if update.evidence is not None]
        if self._explain is None or not with_evidence:
            return JSONResponse(None)
        async with self._explaining:  # one at a time: it computes, and the first compiles
            return JSONResponse(await asyncio.to_thread(self._explain, with_evidence))

    async def basemap(self, _: Request) -> Response:
        """Return what the basemap is; null where there is none."""
        return JSONResponse(None if self._basemap is None else self._basemap.description)

    async def tile(self, request: Request) -> Response:
        place = (request.path_params[name] for name in "zxy")
        content = None if self._basemap is None else self._basemap.tile(*place)
        if self._basemap is None or content is None:
            return Response(status_code=204)
        return Response(content, headers=self._basemap.headers)

    async def handle(self, request: Request) -> Response:
        """Take a handling: JSON of a `HandlingRequest` with the `site`."""
        if request.headers.get("content-type", "").partition(";")[0].strip() != "application/json":
            return PlainTextResponse("content type: application/json\n", 415)
        body = b""
        async for chunk in request.stream():
            body += chunk
            if len(body) > _REQUEST_BYTES_MAX:
                return PlainTextResponse(f"at most {_REQUEST_BYTES_MAX} bytes\n", 413)
        try:
            asked = _SiteRequest.model_validate_json(body)
        except ValidationError as error:
            return PlainTextResponse(f"{first_problem(error)}\n", 400)
        if asked.site not in self._broadcaster.sites:
            return PlainTextResponse(f"site: one of {', '.join(self._broadcaster.sites)}\n", 400)
        answer = await self._broadcaster.handle(asked.site, HandlingRequest(**asked.model_dump(exclude={"site"})))
        if isinstance(answer, str):
            return PlainTextResponse(answer + "\n", 503)
        return JSONResponse(answer.model_dump(mode="json"))


class _SiteRequest(HandlingRequest):
    site: Id


def _brief(updates: int) -> list[bool]:
    """Return which updates are shown without evidence: those in the middle of a long event."""
    return [EVIDENCE_FIRST <= i < updates - EVIDENCE_LAST for i in range(updates)]
