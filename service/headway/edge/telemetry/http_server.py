"""/metrics for Prometheus, /livez and /readyz for an orchestrator."""

import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Final, Self, TypeAlias

CONNECTIONS_MAX: Final = 256
"""Connections at once; further ones are closed."""
CONNECTION_S: Final = 10.0
"""Longest life of a connection, so that a client that sends or reads slowly holds none for ever."""

_Request: TypeAlias = socket.socket | tuple[bytes, socket.socket]
Probe = Callable[[], str | None]
"""Returns the problem; None: there is none."""


class _Server(ThreadingHTTPServer):
    """Bounds the number and the life of connections."""

    daemon_threads = True
    request_queue_size = 128

    def __init__(self, address: tuple[str, int], handler: type[BaseHTTPRequestHandler]) -> None:
        super().__init__(address, handler)
        self._free = threading.BoundedSemaphore(CONNECTIONS_MAX)

    def process_request(self, request: _Request, client_address: object) -> None:
        """Answer in a thread of its own, or close the connection."""
        if self._free.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: _Request, client_address: object) -> None:
        """Answer, for so long at most."""
        over = threading.Timer(CONNECTION_S, _abort, [request])
        over.daemon = True
        over.start()
        try:
            super().process_request_thread(request, client_address)
        finally:
            over.cancel()
            self._free.release()

    def handle_error(self, request: _Request, client_address: object) -> None:
        """Log nothing: the client has left, or its time was over."""


def _abort(request: _Request) -> None:
    assert isinstance(request, socket.socket)
    with suppress(OSError):  # it was closed meanwhile
        request.shutdown(socket.SHUT_RDWR)


class HttpServer:
    """A small server in threads of its own.

    Parameters
    ----------
    host, port
        Where to listen; port 0 takes a free one.
    metrics, content_type
        Body of /metrics, built for each request, and its type.
    liveness_problem, readiness_problem
        Behind /livez and /readyz: 200 without a problem, else 503 with its text.

    Raises
    ------
    OSError
        The address is not available.
    """

    def __init__(
        self,
        host: str,
        port: int,
        *,
        metrics: Callable[[], bytes],
        content_type: str,
        liveness_problem: Probe,
        readiness_problem: Probe,
    ) -> None:
        def probe(check: Probe) -> tuple[int, str, bytes]:
            wrong = check()
            return 503 if wrong else 200, "text/plain; charset=utf-8", f"{wrong or 'ok'}\n".encode()

        pages: dict[str, Callable[[], tuple[int, str, bytes]]] = {
            "/metrics": lambda: (200, content_type, metrics()),
            "/livez": lambda: probe(liveness_problem),
            "/readyz": lambda: probe(readiness_problem),
        }

        class Handler(BaseHTTPRequestHandler):
            timeout = 5.0
            """A silent client holds a thread for at most this time."""

            def do_GET(self) -> None:
                page = pages.get(self.path.partition("?")[0])
                status, kind, body = page() if page else (404, "text/plain", b"/metrics, /livez, /readyz\n")
                self.send_response(status)
                self.send_header("Content-Type", kind)
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, *_: object) -> None:
                """Log nothing: probes arrive each second."""

        self._server = _Server((host, port), Handler)
        self._thread = threading.Thread(target=self._server.serve_forever, name="headway-http", daemon=True)

    @property
    def port(self) -> int:
        """Port that it listens on."""
        return int(self._server.server_address[1])

    def __enter__(self) -> Self:
        """Start to answer."""
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop and release the address."""
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()
