"""The vehicle's HTTP server, and the loop that keeps its lease and its player alive."""

import contextlib
import hmac
import json
import multiprocessing
import os
import re
import secrets
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from automarine_cli.errors import AutomarineError, SettingError
from automarine_cli.link.document import MOST_BYTES, campaign_in
from automarine_cli.link.player import LEASE_S, play
from automarine_cli.link.store import Store
from automarine_cli.link.vehicles.base import Vehicle
from automarine_cli.pipeline.lock import HeldElsewhereError, held
from automarine_cli.pipeline.one_file import write_whole
from automarine_cli.pipeline.parallel import deaf_to_interrupts

BEAT_S = 0.5
QUIET_S = 5.0
"""A request to stop is answered when the vehicle is silent, after this at the latest."""
PATIENCE_S = 30.0
SEND_BUFFER = 1 << 16  # what lies in it when the link is cut has crossed for nothing
BLOCK = 1 << 15
RANGE = re.compile(r"bytes=(\d+)-(\d*)")
RUNS_SCHEMA = "automarine/link-runs/1"


class Handler(BaseHTTPRequestHandler):
    """One request of a client that knows the token."""

    protocol_version = "HTTP/1.1"
    server_version = "automarine"
    sys_version = ""
    timeout = PATIENCE_S
    server: "LinkServer"

    def setup(self) -> None:
        """Keep little of what is sent in the system's own buffers."""
        super().setup()
        with contextlib.suppress(OSError):
            self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)

    def do_GET(self) -> None:
        """`/state`, `/runs` and `/runs/NAME`."""
        store = self.server.store
        if not self._is_allowed():
            return
        if self.path == "/state":
            self._answer(HTTPStatus.OK, store.state())
        elif self.path == "/runs":
            self._answer(HTTPStatus.OK, {"schema": RUNS_SCHEMA, "runs": [log.to_json() for log in store.logs()]})
        elif self.path.startswith("/runs/"):
            self._send_log(unquote(self.path.removeprefix("/runs/")))
        else:
            self._refuse(HTTPStatus.NOT_FOUND, f"there is no {self.path[:60]}; ask for /state, /runs or /runs/NAME")

    def do_PUT(self) -> None:
        """`/campaigns/ID`: kept when it is whole, has the hash ID, and can be driven."""
        name = self.path.removeprefix("/campaigns/")
        if not self._is_allowed():
            return
        size = self.headers.get("Content-Length", "")
        if not re.fullmatch("[0-9a-f]{64}", name) or name == self.path:
            self._refuse(HTTPStatus.NOT_FOUND, "a campaign is put to /campaigns/SHA-256 of its document")
        elif not re.fullmatch(r"\d{1,9}", size) or int(size) > MOST_BYTES:
            self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"give a Content-Length of {MOST_BYTES} at most")
        elif len(content := self.rfile.read(int(size))) < int(size):
            self.close_connection = True  # cut before its end: as if it had never come
        else:
            try:
                is_new = self.server.accept(content, name)
            except AutomarineError as problem:
                self._refuse(HTTPStatus.UNPROCESSABLE_ENTITY, str(problem))
                return
            self._answer(HTTPStatus.CREATED if is_new else HTTPStatus.OK, {"accepted": name, "new": is_new})

    def do_POST(self) -> None:
        """`/stop`: neutral, silence, the run closed; answered when that is so."""
        if not self._is_allowed():
            return
        if self.path == "/stop":
            self._answer(HTTPStatus.OK, {"stopped": True, "quiet": self.server.stop()})
        else:
            self._refuse(HTTPStatus.NOT_FOUND, "only /stop is posted to")

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing: who asked is nobody's business."""

    def _is_allowed(self) -> bool:
        given = self.headers.get("Authorization", "").encode("utf-8", "replace")
        if hmac.compare_digest(given, f"Bearer {self.server.token}".encode()):
            return True
        self._refuse(HTTPStatus.UNAUTHORIZED, "the token is missing or wrong")
        return False

    def _send_log(self, name: str) -> None:
        log = next((one for one in self.server.store.logs() if one.name == name), None)
        if log is None or log.sha256 is None:
            status = HTTPStatus.NOT_FOUND if log is None else HTTPStatus.CONFLICT
            self._refuse(status, "there is no such log" if log is None else "this run is still driven; ask later")
            return
        asked = RANGE.fullmatch(self.headers.get("Range", ""))
        first = int(asked[1]) if asked else 0
        last = min(int(asked[2]), log.size - 1) if asked and asked[2] else log.size - 1
        if asked and (first >= log.size or last < first):
            self._refuse(HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE, f"the log has {log.size} bytes")
            return
        self.send_response(HTTPStatus.PARTIAL_CONTENT if asked else HTTPStatus.OK)
        self.send_header("Content-Type", "text/csv; charset=utf-8")
        self.send_header("Accept-Ranges", "bytes")
        self.send_header("ETag", f'"{log.sha256}"')
        if asked:
            self.send_header("Content-Range", f"bytes {first}-{last}/{log.size}")
        self.send_header("Content-Length", str(last + 1 - first))
        self.end_headers()
        with (self.server.store.runs / name).open("rb") as file:
            file.seek(first)
            left = last + 1 - first
            while left and (block := file.read(min(BLOCK, left))):
                self.wfile.write(block)
                left -= len(block)

    def _refuse(self, status: HTTPStatus, why: str) -> None:
        self.close_connection = True
        self._answer(status, {"error": why})

    def _answer(self, status: HTTPStatus, data: object) -> None:
        content = json.dumps(data).encode()
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)


class LinkServer(ThreadingHTTPServer):
    """Answers requests on one address, each in a thread."""

    daemon_threads = True

    def __init__(self, address: tuple[str, int], store: Store, vehicle: Vehicle, token: str) -> None:
        super().__init__(address, Handler)
        self.store, self.vehicle, self.token = store, vehicle, token
        self._one_at_a_time = threading.Lock()

    def accept(self, content: bytes, name: str) -> bool:
        """Keep a campaign that the vehicle can drive; False where it is here already. Raises SettingError."""
        with self._one_at_a_time:
            self.vehicle.refuse(campaign_in(content))
            return self.store.accept(content, name)

    def stop(self) -> bool:
        """Stop all campaigns; whether the vehicle is silent."""
        with self._one_at_a_time:
            self.store.stop()
        ends = time.monotonic() + QUIET_S
        while self.store.is_playing() and time.monotonic() < ends:
            time.sleep(0.02)
        return not self.store.is_playing()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Nothing: a link that is cut is no error."""


@dataclass(frozen=True)
class Serving:
    """Where the server can be reached, and the word that it wants to hear."""

    url: str
    token: str


def token_of(folder: Path) -> str:
    """The vehicle's token, made at the first start, for its owner's eyes only."""
    file = folder / "token"
    if not file.exists():
        new = folder / ".token"
        new.unlink(missing_ok=True)
        with os.fdopen(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="ascii") as stream:
            stream.write(secrets.token_urlsafe(24) + "\n")
        new.replace(file)
    return file.read_text(encoding="ascii").strip()


def serve(
    folder: Path, vehicle: Vehicle, address: tuple[str, int], speed: float, tell: Callable[[Serving], object]
) -> None:
    """Serve a folder until interrupted; `tell` hears the address. Raises SettingError, OutputError."""
    store = Store(folder)
    store.prepare()
    try:
        with held(folder / ".server"):
            _serve(store, vehicle, address, speed, tell)
    except HeldElsewhereError:
        raise SettingError(f"{folder} is served already; end that `automarine serve`, or give another folder") from None


def _serve(
    store: Store, vehicle: Vehicle, address: tuple[str, int], speed: float, tell: Callable[[Serving], object]
) -> None:
    word = secrets.token_hex(8)
    write_whole(store.lease, word)
    try:
        server = LinkServer(address, store, vehicle, token_of(store.folder))
    except OSError as problem:
        raise SettingError(
            f"cannot listen on {address[0]}:{address[1]} ({problem.strerror}); give another --address"
        ) from None
    threading.Thread(target=server.serve_forever, daemon=True).start()
    tell(Serving(f"http://{address[0]}:{server.server_address[1]}", server.token))
    start = partial(multiprocessing.get_context("spawn").Process, target=play, args=(store, vehicle, speed, word))
    player = None
    try:
        while True:
            store.lease.touch()
            if player is None or not player.is_alive():  # a player that died begins with the next run
                player = start(name="player")
                with deaf_to_interrupts():
                    player.start()
            time.sleep(BEAT_S)
    finally:
        store.lease.unlink(missing_ok=True)  # the player sends neutral and closes its run
        server.server_close()
        if player is not None:
            player.join(LEASE_S)
