"""The page that a browser opens: Rerun's web viewer in a frame, loaded again when the world is.

Doorway (loopback) --doorway.html--> browser --frame--> web viewer --> the world's server
"""

from __future__ import annotations

import http.server
import importlib.resources
import threading

from dashboards.live import HOST


class Doorway:
    """Serves the page until it is closed; raises OSError when there is no port for it."""

    def __init__(self) -> None:
        page = importlib.resources.files(__package__).joinpath("doorway.html").read_bytes()

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                self.send_response(200 if self.path.split("?")[0] == "/" else 404)
                self.send_header("Content-Type", "text/html; charset=utf-8")
                self.send_header("Content-Length", str(len(page)))
                self.end_headers()
                self.wfile.write(page)

            def log_message(self, *_: object) -> None:
                pass  # nobody asked

        self._server = http.server.ThreadingHTTPServer((HOST, 0), Handler)
        self._server.daemon_threads = True
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def address(self, web_port: int, world_port: int) -> str:
        """What to open; it tells all three ports that are used, for who needs a tunnel."""
        port = self._server.server_address[1]
        return f"http://{HOST}:{port}/?viewer={web_port}&world={world_port}"

    def close(self) -> None:
        """End; the page in the browser stays."""
        self._server.shutdown()
        self._server.server_close()
