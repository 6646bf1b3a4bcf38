"""/metrics for Prometheus, /livez and /readyz for an orchestrator."""

import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Self

Probe = Callable[[], str | None]
"""Returns the problem; None: there is none."""


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

        self._server = ThreadingHTTPServer((host, port), Handler)
        self._server.daemon_threads = True
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
