"""Serves the viewer to this machine alone: bound to 127.0.0.1, and to requests that name it so."""

from __future__ import annotations

import json
import queue
import sys
import threading
from collections.abc import Callable, Mapping
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from kinid.errors import InputError
from kinid.writers import Json

LOOPBACK = "127.0.0.1"
#: a comment goes down a quiet stream so often [s], so that a browser that went away is noticed
HEARTBEAT = 5.0
#: all that a page needs is in it; it listens to this server alone, and nobody frames it
POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' blob: data:; style-src 'unsafe-inline'; "
    "img-src data: blob:; font-src data:; connect-src 'self' data: blob:; worker-src blob: data:; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'none'"
)


class _Server(ThreadingHTTPServer):
    """A server that doesn't write tracebacks to the terminal of who started it."""

    daemon_threads = True

    def handle_error(self, request: object, client_address: object) -> None:
        """Whoever left while he was answered is no news; anything else is told in a line."""
        error = sys.exc_info()[1]
        if not isinstance(error, OSError):
            print(f"kinid: a page was not shown: {' '.join(str(error).split())[:200]}", file=sys.stderr)


class ViewServer:
    """A page and a stream of what changes in it (server-sent events).

    Args:
        page: makes the page; asked once, and again after a message was sent. port: 0 chooses a free one.
        option: of the command line that names it.

    Raises:
        InputError: the port is taken.
    """

    def __init__(self, page: Callable[[], str], port: int = 0, option: str = "--port") -> None:
        self._page = page
        self._listeners: list[queue.Queue[str | None]] = []
        self._lock = threading.Lock()
        self._built: bytes | None = None
        self._building = threading.Lock()
        owner = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def end_headers(self) -> None:
                """No guessing of kinds, whatever is answered."""
                self.send_header("X-Content-Type-Options", "nosniff")
                super().end_headers()

            def do_GET(self) -> None:
                """The page, or the stream."""
                owner._answer(self)

            def log_message(self, format: str, *args: object) -> None:
                """Say nothing."""

        try:
            self._server = _Server((LOOPBACK, port), Handler)
        except OSError as error:
            raise InputError(
                f"port {port}, which can't be had ({error.strerror})",
                "a free port of this machine",
                f"choose another {option}, or 0 for any",
            ) from None
        self.port = int(self._server.server_address[1])
        self.url = f"http://{LOOPBACK}:{self.port}/"
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.1,), daemon=True)
        self._thread.start()

    @property
    def visitors(self) -> int:
        """Pages that are listening."""
        return len(self._listeners)

    def send(self, message: Json) -> None:
        """To all pages that are open."""
        text = json.dumps(message, allow_nan=False)
        with self._building:
            self._built = None
        with self._lock:
            for listener in self._listeners:
                listener.put(text)

    def close(self) -> None:
        """Stop serving."""
        with self._lock:
            for listener in self._listeners:
                listener.put(None)
        self._server.shutdown()
        self._server.server_close()

    def _answer(self, request: BaseHTTPRequestHandler) -> None:
        # a page of elsewhere may lead a browser here under another name (DNS rebinding): it gets nothing
        if request.headers.get("Host") not in {f"{LOOPBACK}:{self.port}", f"localhost:{self.port}"}:
            request.send_error(403, "this server is for its own machine")
            return
        try:
            self._serve(request)
        except OSError:  # the browser has gone while it was answered
            request.close_connection = True

    def _serve(self, request: BaseHTTPRequestHandler) -> None:
        path = request.path.split("?")[0]
        if path == "/":
            body = self._body()
            size = {
                "Content-Length": str(len(body)),
                "Cross-Origin-Resource-Policy": "same-origin",
                "Content-Security-Policy": POLICY,
            }
            _begin(request, "text/html; charset=utf-8", size)
            request.wfile.write(body)
        elif path == "/live":
            self._stream(request)
        else:
            request.send_error(404)

    def _body(self) -> bytes:
        """The page: built for the first visitor, and anew only after something in it has changed."""
        with self._building:
            if self._built is None:
                self._built = self._page().encode()
            return self._built

    def _stream(self, request: BaseHTTPRequestHandler) -> None:
        _begin(request, "text/event-stream", {"Connection": "close"})
        request.close_connection = True
        listener: queue.Queue[str | None] = queue.Queue()
        with self._lock:
            self._listeners.append(listener)
        try:
            while True:
                try:
                    text = listener.get(timeout=HEARTBEAT)
                except queue.Empty:
                    request.wfile.write(b": quiet\n\n")
                    request.wfile.flush()
                    continue
                if text is None:
                    return
                request.wfile.write(b"data: " + text.encode() + b"\n\n")
                request.wfile.flush()
        except OSError:
            return  # the browser has gone
        finally:
            with self._lock:
                self._listeners.remove(listener)


def _begin(request: BaseHTTPRequestHandler, kind: str, headers: Mapping[str, str]) -> None:
    """A good answer, which no cache keeps, up to its body."""
    request.send_response(200)
    for name, value in {"Content-Type": kind, "Cache-Control": "no-store", **headers}.items():
        request.send_header(name, value)
    request.end_headers()
