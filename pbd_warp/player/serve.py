"""Shows one page in the browser, from this machine to this machine."""

from __future__ import annotations

import threading
import webbrowser
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
"""Names that a browser reaches this machine by; with another one, somebody else's page could read ours."""


class PageServer:
    """Serves a page on a free port of this machine, from a thread that ends with the process.

    Attributes:
        url: Its address. fetched: Set when somebody has got the page.
    """

    def __init__(self, text: str, port: int = 0):
        body = text.encode()
        self.fetched = fetched = threading.Event()

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                if self.headers.get("Host", "").rpartition(":")[0] not in LOOPBACK:
                    self.send_error(HTTPStatus.FORBIDDEN)
                elif self.path != "/":
                    self.send_error(HTTPStatus.NOT_FOUND)
                else:
                    self.send_response(HTTPStatus.OK)
                    self.send_header("Content-Type", "text/html; charset=utf-8")
                    self.send_header("Content-Length", str(len(body)))
                    self.end_headers()
                    self.wfile.write(body)
                    fetched.set()

            def log_message(self, format: str, *args: object) -> None:
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", port), Handler)
        self.url = f"http://127.0.0.1:{self._server.server_port}/"
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def open_browser(self) -> None:
        """In a thread: it may take until the browser ends."""
        threading.Thread(target=webbrowser.open, args=(self.url,), daemon=True).start()

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()


def serve(text: str, title: str, say: Callable[[str], object] = print) -> None:
    """Open a page in the browser, and go on when it has arrived there."""
    server = PageServer(text)
    say(f"{title} is at {server.url}")
    server.open_browser()
    server.fetched.wait()
