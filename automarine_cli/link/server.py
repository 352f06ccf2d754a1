"""The vehicle's HTTP server, and the loop that keeps its lease and its player alive."""

import contextlib
import hashlib
import hmac
import json
import math
import multiprocessing
import os
import re
import secrets
import socket
import stat
import threading
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from automarine_cli.errors import AutomarineError, OutputError, SettingError
from automarine_cli.link.document import ID_LETTERS, MAX_CAMPAIGN_BYTES, SHA256, State
from automarine_cli.link.player import LEASE_S, play
from automarine_cli.link.store import ASKED_TO_STOP, HeldElsewhereError, Store, held, sync_folder
from automarine_cli.link.vehicles.base import Vehicle
from automarine_cli.pipeline.parallel import deaf_to_interrupts
from automarine_cli.pipeline.results_folder import write_whole

LEASE_BEAT_S = 0.5
QUIET_S = 5.0  # A request to stop is answered when the vehicle is silent, after this at the latest
REQUEST_PATIENCE_S = 30.0
HEADER_S, MAX_STRANGERS = 10.0, 64  # so long, and so many, may stay without the token; the first goes first
SEND_BLOCK_B = 1 << 15
RANGE = re.compile(r"bytes=(\d+)-(\d*)")
STOP = re.compile(r"/stop(?:/([0-9a-f]{64}(?:,[0-9a-f]{64})*))?")


class Handler(BaseHTTPRequestHandler):
    protocol_version, server_version, sys_version, timeout = "HTTP/1.1", "automarine", "", REQUEST_PATIENCE_S
    server: "LinkServer"

    def parse_request(self) -> bool:
        """Refuse whoever does not show the token, whatever is asked for."""
        if not super().parse_request():
            return False
        header = self.headers.get("Authorization", "").encode("utf-8", "replace")
        if hmac.compare_digest(header, f"Bearer {self.server.token}".encode()) and self.server.token:
            self.server.know(self.connection)
            return True
        self._refuse(HTTPStatus.UNAUTHORIZED, "the token is missing or wrong")
        return False

    def do_GET(self) -> None:
        if self.path == "/state":
            self._answer(HTTPStatus.OK, asdict(self.server.state()))
        elif self.path == "/runs":
            self._answer(HTTPStatus.OK, asdict(self.server.store.listing()))
        elif self.path.startswith("/runs/"):
            self._send_log(unquote(self.path.removeprefix("/runs/")))
        else:
            self._refuse(HTTPStatus.NOT_FOUND, f"there is no {self.path[:60]}; ask for /state, /runs or /runs/NAME")

    def do_PUT(self) -> None:
        """`/campaigns/ID`: kept when it is whole, has the hash ID, and can be driven."""
        name, size = self.path.removeprefix("/campaigns/"), self.headers.get("Content-Length", "")
        if not SHA256.fullmatch(name) or name == self.path:
            self._refuse(HTTPStatus.NOT_FOUND, "a campaign is put to /campaigns/SHA-256 of its document")
        elif not re.fullmatch(r"\d{1,9}", size) or int(size) > MAX_CAMPAIGN_BYTES:
            self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"give a Content-Length of {MAX_CAMPAIGN_BYTES} at most")
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
        """`/stop`, or `/stop/ID,ID`: neutral, silence, the run closed; answered when that is so."""
        if match := STOP.fullmatch(self.path):
            only = None if match[1] is None else match[1].split(",")
            self._answer(HTTPStatus.OK, {"stopped": True, "quiet": self.server.stop(only)})
        else:
            self._refuse(HTTPStatus.NOT_FOUND, "only /stop and /stop/ID are posted to")

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing: who asked is nobody's business."""

    def _send_log(self, name: str) -> None:
        log = self.server.store.log(name)
        if log is None or log.sha256 is None:
            status = HTTPStatus.NOT_FOUND if log is None else HTTPStatus.CONFLICT
            self._refuse(status, "there is no such log" if log is None else "this run is still driven; ask later")
            return
        byte_range = RANGE.fullmatch(self.headers.get("Range", ""))
        first = int(byte_range[1]) if byte_range else 0
        last = min(int(byte_range[2]), log.size - 1) if byte_range and byte_range[2] else log.size - 1
        if byte_range and (first >= log.size or last < first):
            self._refuse(HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE, f"the log has {log.size} bytes")
            return
        with self.server.store.open_log(name) as file:
            file.seek(first)
            remaining = last + 1 - first
            try:
                block = file.read(min(SEND_BLOCK_B, remaining))
            except OSError as problem:  # or a disk that fails looks like a link that is cut, for ever
                self._refuse(HTTPStatus.INTERNAL_SERVER_ERROR, f"{name} cannot be read ({problem.strerror})")
                return
            self.send_response(HTTPStatus.PARTIAL_CONTENT if byte_range else HTTPStatus.OK)
            self.send_header("Content-Type", "text/csv; charset=utf-8")
            self.send_header("Accept-Ranges", "bytes")
            self.send_header("ETag", f'"{log.sha256}"')
            if byte_range:
                self.send_header("Content-Range", f"bytes {first}-{last}/{log.size}")
            self.send_header("Content-Length", str(remaining))
            self.end_headers()
            while block:
                self.wfile.write(block)
                remaining -= len(block)
                block = file.read(min(SEND_BLOCK_B, remaining))

    def _refuse(self, status: HTTPStatus, why: str) -> None:
        self.close_connection = True
        self._answer(status, {"error": why})

    def _answer(self, status: HTTPStatus, data: object) -> None:
        content = json.dumps(data).encode()
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("ETag", f'"{hashlib.sha256(content).hexdigest()}"')  # a spoilt byte must not be believed
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)


class LinkServer(ThreadingHTTPServer):
    """Answers requests on one address, each in a thread; `tell` hears what it accepts and refuses. `resumed` says which
    campaigns go on by themselves, `silenced` that the disk refused a stop and nothing is driven any more."""

    daemon_threads = True
    request_queue_size = MAX_STRANGERS

    def __init__(
        self, address: tuple[str, int], store: Store, vehicle: Vehicle, token: str,
        tell: Callable[[str], object] = lambda _: None,
    ) -> None:  # fmt: skip
        self.address_family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
        super().__init__(address, Handler)
        self.store, self.vehicle, self.token, self.silenced = store, vehicle, token, ""
        self.resumed, self._stopped = store.resumed(), -math.inf
        self._one_at_a_time, self._door = threading.Lock(), threading.Lock()
        self._strangers: dict[socket.socket, float] = {}
        self._tell, self._refused = tell, ""

    def accept(self, content: bytes, name: str) -> bool:
        """Keep a campaign, stopped if all were while it waited; False if it is here. Raises AutomarineError."""
        came = time.monotonic()
        with self._one_at_a_time:
            try:
                if self.silenced:
                    raise SettingError(self.silenced)
                is_new = self.store.accept(content, name, self.vehicle.refuse, lambda: came <= self._stopped)
            except AutomarineError as problem:
                refusal = f"campaign {name[:ID_LETTERS]} is refused: {problem}"
                if self._refused != refusal:  # it is sent again
                    self._tell(refusal)
                self._refused = refusal
                raise
            if is_new:
                self._tell(f"campaign {name[:ID_LETTERS]} is accepted")
            return is_new

    def stop(self, only: list[str] | None = None) -> bool:
        """Stop all campaigns, or `only` those with some ids; whether the vehicle is silent."""
        if only is None:
            self._stopped = time.monotonic()
        try:
            self.store.stop(ASKED_TO_STOP, only)
        except OSError as problem:
            self.silence(problem)
        ends = time.monotonic() + QUIET_S
        while self.store.is_playing() and time.monotonic() < ends:
            time.sleep(0.02)
        return not self.store.is_playing()

    def silence(self, problem: Exception) -> None:
        """End the lease, as the disk is of no use: the player sends neutral and ends."""
        self.silenced = f"the disk failed ({problem}); nothing is driven until `automarine serve` is started again"
        with contextlib.suppress(OSError):
            self.store.lease.unlink(missing_ok=True)

    def state(self) -> State:
        state = self.store.state()
        return replace(state, troubles=(*state.troubles, *self.resumed, *filter(None, [self.silenced])))

    def know(self, connection: socket.socket) -> None:
        with self._door:
            self._strangers.pop(connection, None)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Begin a thread for a connection, after one that has said nothing for longest gave way if there are many."""
        with self._door:
            if len(self._strangers) >= MAX_STRANGERS:
                self._hang_up(next(iter(self._strangers)))
            self._strangers[request] = time.monotonic()
        super().process_request(request, client_address)

    def service_actions(self) -> None:
        """Hang up on who takes too long to show the token."""
        with self._door:
            latest = time.monotonic() - HEADER_S
            for connection in [connection for connection, since in self._strangers.items() if since < latest]:
                self._hang_up(connection)

    def shutdown_request(self, request: Any) -> None:
        self.know(request)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Nothing: a link that is cut is no error."""

    def _hang_up(self, connection: socket.socket) -> None:
        del self._strangers[connection]
        with contextlib.suppress(OSError):
            connection.shutdown(socket.SHUT_RDWR)


def token_of(folder: Path) -> str:
    """The vehicle's token, made at the first start, for its owner's eyes only. Raises SettingError, OSError."""
    file = folder / "token"
    if not os.path.lexists(file):
        new = folder / ".token"
        new.unlink(missing_ok=True)
        with os.fdopen(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="ascii") as stream:
            stream.write(secrets.token_urlsafe(24) + "\n")
            stream.flush()
            os.fsync(stream.fileno())
        new.replace(file)
        sync_folder(folder)
    mode = file.lstat().st_mode
    if not stat.S_ISREG(mode):
        raise SettingError(f"{file} is a link or a folder; delete it, and a new token is made")
    if os.name != "nt" and mode & 0o077:
        remedy = "delete it, and a new token is made, or `chmod 600` it"
        raise SettingError(f"others may read or change {file} (mode {mode & 0o777:o}); {remedy}")
    token = file.read_text(encoding="utf-8", errors="replace").strip()
    if not token or not token.isascii() or not token.isprintable():
        raise SettingError(f"{file} holds no token; delete it, and a new one is made")
    return token


def serve(folder: Path, vehicle: Vehicle, address: tuple[str, int], speed: float, tell: Callable[..., object]) -> None:
    """Serve a folder until interrupted; `tell` hears the address with the token, then sentences on campaigns and on
    what in the folder is not right. Raises SettingError, OutputError."""
    store = Store(folder)
    store.prepare()
    try:
        with held(folder / ".server"):
            _serve(store, vehicle, address, speed, tell)
    except HeldElsewhereError:
        raise SettingError(f"{folder} is served already; end that `automarine serve`, or give another folder") from None


def _serve(store: Store, vehicle: Vehicle, address: tuple[str, int], speed: float, tell: Callable[..., object]) -> None:
    word, where = secrets.token_hex(8), f"[{address[0]}]" if ":" in address[0] else address[0]
    try:
        token = token_of(store.folder)
    except OSError as problem:
        raise OutputError(f"{store.folder} has no room for a token ({problem.strerror}); give another folder") from None
    write_whole(store.lease, word)
    try:
        server = LinkServer(address, store, vehicle, token, tell)
    except OSError as problem:
        why = f"cannot listen on {where}:{address[1]} ({problem.strerror}); give another --address"
        raise SettingError(why) from None
    threading.Thread(target=server.serve_forever, daemon=True).start()
    old = {campaign.id for campaign in server.state().campaigns if campaign.over}
    tell(f"http://{where}:{server.server_address[1]}", token)
    threading.Thread(target=_tell_news, args=(server, tell, old), daemon=True).start()  # the lease waits for no disk
    # without what the store remembers: that would cross to the process
    process, args = multiprocessing.get_context("spawn").Process, (Store(store.folder), vehicle, speed, word)
    player = None
    try:
        while True:
            if not server.silenced:
                try:
                    store.lease.touch()
                except OSError as problem:
                    server.silence(problem)
            if not server.silenced and (player is None or not player.is_alive()):
                player = process(target=play, args=args, name="player")  # one that died begins with the next run
                with deaf_to_interrupts():
                    player.start()
            time.sleep(LEASE_BEAT_S)
    finally:
        with contextlib.suppress(OSError):
            store.lease.unlink(missing_ok=True)  # the player sends neutral and closes its run
        server.server_close()
        if player is not None:
            player.join(LEASE_S)


def _tell_news(server: LinkServer, tell: Callable[[str], object], old: set[str]) -> None:
    """Tell for ever which campaigns are over and what is not right in the folder, beside the `old` news."""
    while True:
        with contextlib.suppress(OSError):
            state = server.state()
            news = {c.id: c.says for c in state.campaigns if c.over} | {trouble: trouble for trouble in state.troubles}
            for key in sorted(set(news) - old):
                tell(news[key])
            old = old | set(news)
        time.sleep(LEASE_BEAT_S)
