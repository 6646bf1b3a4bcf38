"""What is done beside a service that runs as a child."""

import threading
from http.server import BaseHTTPRequestHandler, HTTPServer

from sim.until import until

from headway.cli.run.service_process import scraping


def test_metrics_are_read_all_the_while_and_nobody_minds_when_they_are_not_there() -> None:
    asked: list[str] = []

    class Metrics(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked.append(self.path)
            self.send_response(200)
            self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    with HTTPServer(("127.0.0.1", 0), Metrics) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        url = f"http://127.0.0.1:{server.server_port}/metrics"
        with scraping(url, 0.01):
            until(lambda: len(asked) >= 3)
            server.shutdown()
    assert set(asked) == {"/metrics"}
    with scraping(url, 0.01):
        threading.Event().wait(0.05)
