"""The local page: the waterfall beside the growing map, by Python's own server.

    GET /                the page, one file that asks for the others once or twice a second
    GET /state.json      numbers, health, points, walls, path
    GET /grid.png        the occupancy grid, row 0 the largest y
    GET /waterfall.png   the last rows of the waterfall, the newest below

Nothing is taken from whoever asks but one of these names. A page of another site that lets its name
point to this machine is refused: the browser tells which host it means.
"""

import json
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from typing import Any

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.checks import BadValue
from echolearn.robot.live.live_map import LiveMap, LivePose
from echolearn.robot.pages import filled_page
from echolearn.robot.png import png_bytes
from echolearn.storage.files import one_line

SAFE = (
    "default-src 'none'; img-src 'self'; connect-src 'self'; "
    "style-src 'unsafe-inline'; script-src 'unsafe-inline'"
)
"""What the page may load: nothing from elsewhere."""

GREYS = np.repeat(np.arange(256, dtype=np.uint8)[:, None], 3, axis=1)


class Page:
    """A server of the page, in threads of its own."""

    def __init__(self, live: LiveMap, *, host: str, port: int) -> None:
        """Start it.

        Args:
            live: what is shown.
            host: address that it is bound to.
            port: its port; 0 takes any that is free.

        Raises:
            BadValue: the port is taken, or the address is none of this machine.
        """
        try:
            self._server = ThreadingHTTPServer((host, port), _handler(live, host))
        except (OSError, OverflowError) as error:
            reason = one_line(error)
            raise BadValue(f"port={port} at {host}: {reason}; port=0 takes a free one") from None
        self._server.daemon_threads = True
        self.address = f"http://{host}:{self._server.server_port}/"
        print(f"page: {self.address}", flush=True)
        Thread(target=self._server.serve_forever, daemon=True).start()

    def pose(self, live: LiveMap, new: LivePose) -> None:
        """Do nothing: whoever looks asks."""

    def map(self, live: LiveMap) -> None:
        """Do nothing: whoever looks asks."""

    def close(self) -> None:
        """Stop it."""
        self._server.shutdown()
        self._server.server_close()


def _handler(live: LiveMap, host: str) -> type[BaseHTTPRequestHandler]:
    """Return what answers requests."""
    answers: dict[str, tuple[str, Callable[[LiveMap], bytes]]] = {
        "/": ("text/html; charset=utf-8", lambda _: filled_page("robot", "live.html", filled={})),
        "/state.json": ("application/json", state_json),
        "/grid.png": ("image/png", grid_png),
        "/waterfall.png": ("image/png", waterfall_png),
    }

    class Handler(BaseHTTPRequestHandler):
        """Answers one request."""

        def do_GET(self) -> None:  # noqa: N802
            """Answer."""
            name = (self.headers.get("Host") or "").rpartition(":")[0]
            local = host not in ("127.0.0.1", "localhost") or name in ("127.0.0.1", "localhost")
            path = self.path.partition("?")[0]
            if not local or path not in answers:
                self.send_error(404 if local else 403)
                return
            kind, answer = answers[path]
            content = answer(live)
            self.send_response(200)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(content)))
            self.send_header("Cache-Control", "no-store")
            self.send_header("Content-Security-Policy", SAFE)
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, *_: Any) -> None:
            """Say nothing of who looks."""

    return Handler


def state_json(live: LiveMap) -> bytes:
    """Return what the page shows besides images."""
    with live.lock:
        pixels = live.grid.size
        health = live.health
        last = live.last
        about: dict[str, Any] = {
            "poses": live.poses,
            "left_out": live.left_out,
            "shown": live.shown,
            "ended": live.ended,
            "beyond": live.grid.beyond,
            "lines": live.lines,
            "complaints": list(live.complaints),
            "points": live.sample.rows[:, [0, 1, 4]].round(3).tolist(),
            "walls": [[*line.start.tolist(), *line.end.tolist()] for line in live.walls],
            "path": [list(place) for place in live.path],
            "grid": [*live.grid.corner, *pixels, live.grid.resolution],
        }
        if last is not None:
            about |= {"number": str(last.number), "heading": float(last.pose.heading)}
        if health is not None:
            about["level_db"] = _numbers(health.level_db[-1])
            about["noise_db"] = _numbers(health.noise_db[-1:])
            about["snr_db"] = _numbers(health.snr_db[-1:])
            about["time_zero"] = health.time_zero
            about["verdicts"] = list(health.verdicts)
    return json.dumps(about).encode()


def _numbers(values: Array) -> list[float | None]:
    """Return numbers as JSON has them: what is not finite is null."""
    return [round(float(each), 1) if np.isfinite(each) else None for each in values]


def grid_png(live: LiveMap) -> bytes:
    """Return the occupancy grid as an image."""
    with live.lock:
        pixels, _ = live.grid.pixels()
    if not pixels.size:
        pixels = np.full((1, 1), 205, dtype=np.uint8)
    return png_bytes(pixels[::-1], GREYS)


def waterfall_png(live: LiveMap) -> bytes:
    """Return the last rows of the waterfall as an image."""
    with live.lock:
        rows = list(live.heard)
    return png_bytes(np.array(rows) if rows else np.zeros((1, 1), dtype=np.uint8))
