"""Asks an application without a server between."""

import asyncio
from typing import Any

import httpx
from starlette.applications import Starlette


class PageClient:
    """Keeps cookies; does not follow redirects."""

    def __init__(self, app: Starlette, base: str = "http://localhost") -> None:
        self._app = app
        self._base = base
        self._cookies = httpx.Cookies()

    def ask(self, method: str, path: str, **options: Any) -> httpx.Response:
        async def once() -> httpx.Response:
            transport = httpx.ASGITransport(app=self._app)
            async with httpx.AsyncClient(transport=transport, base_url=self._base, cookies=self._cookies) as client:
                answer = await client.request(method, path, **options)
                self._cookies = client.cookies
                return answer

        return asyncio.run(once())

    def get(self, path: str, **options: Any) -> httpx.Response:
        return self.ask("GET", path, **options)
