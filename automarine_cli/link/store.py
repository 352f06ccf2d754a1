"""The vehicle's folder: campaigns that were accepted, logs that were closed, and the marks between its two processes.

Nothing here is ever changed once it has its name: a file is written beside its place, sent to the disk, and
renamed. What is known of a campaign is told by which logs there are, so a power cut loses no count. What must work
on a full disk is a rename. Links are not followed, and what is none of ours is passed over, and told.
"""

import ctypes
import errno
import hashlib
import os
import stat
import sys
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

from automarine_cli.errors import OutputError, SettingError
from automarine_cli.link import document as wire
from automarine_cli.link.document import CampaignState, LinkCampaign, Listing, Log, State
from automarine_cli.pipeline.results_folder import write_whole
from automarine_cli.text import printable

ASKED = "asked to stop"
LONGEST_WHY = 1000
"""Bytes that a campaign's reason to stop has room for from the beginning."""
DEATHS = 3
"""So often may the player's process end before a run's log has a line; after that the run is not begun again."""
NO_LINKS = getattr(os, "O_NOFOLLOW", 0)
KEEP_SIZE = 1  # Linux, linux/falloc.h


@dataclass(frozen=True)
class Store:
    folder: Path
    _memory: dict[tuple[str, int, int], Any] = field(default_factory=dict, compare=False, repr=False)
    """What files of that name, time and size were read as: they never change."""

    @property
    def runs(self) -> Path:
        return self.folder / "runs"

    @property
    def campaigns(self) -> Path:
        """Where campaigns are, numbered in the order in which they came."""
        return self.folder / "campaigns"

    @property
    def lease(self) -> Path:
        """What the server touches while it lives; holds the word of the server that wrote it."""
        return self.folder / "lease"

    def prepare(self) -> None:
        try:
            self.runs.mkdir(parents=True, exist_ok=True)
            self.campaigns.mkdir(exist_ok=True)
        except OSError as problem:
            raise OutputError(f"{self.folder} cannot be written to ({problem.strerror}); give another folder") from None

    def accepted(self) -> list[LinkCampaign]:
        return [document for document in self._documents() if isinstance(document, LinkCampaign)]

    def accept(self, content: bytes, name: str, refuse: Callable[[LinkCampaign], object] = lambda _: None) -> bool:
        """Keep a campaign whose document has the hash `name`; False where it is here already.

        For one caller at a time. Raises SettingError for another hash, a document that is none, a campaign that
        the battery does not carry, and what `refuse` does; OutputError where there is no room for it."""
        if (digest := hashlib.sha256(content).hexdigest()) != name:
            raise SettingError(f"the campaign has the SHA-256 {digest[:12]}..., not {name[:12]}...; try again")
        there = [path.stem.rpartition("_")[2] for path in self.campaigns.glob("*.json")]
        if name in there:
            return False
        campaign = wire.campaign_in(content)
        if campaign.text.encode() != content:
            raise SettingError("the campaign is not written as `automarine collect` writes it; use that to send it")
        refuse(campaign)
        campaign.refuse_beyond_reserve()
        if any(other[: wire.SHORT] == name[: wire.SHORT] for other in there):
            raise SettingError("another campaign here has an id that begins alike; make the plan with another --seed")
        write_whole(self._ready(campaign), " " * LONGEST_WHY)
        document = self.campaigns / f"{len(there) + 1:04d}_{name}.json"
        write_whole(document, campaign.text)
        sync_folder(self.campaigns)
        self._memory[_key(document.name, document.lstat())] = campaign
        return True

    def stop(self, why: str = ASKED, only: Collection[str] | None = None) -> None:
        """Mark every campaign here, or `only` those with some ids, as stopped, for good.

        That is a rename of a file that was made with the campaign. Raises OSError, OutputError where the disk refuses
        even that."""
        for campaign in self.accepted():
            if (only is None or campaign.id in only) and not self.is_stopped(campaign):
                ready, mark = self._ready(campaign), self._stop_mark(campaign)
                with suppress(OSError), _opened(ready, os.O_WRONLY) as file:
                    file.write(why.encode()[:LONGEST_WHY].ljust(LONGEST_WHY))
                    file.flush()
                    os.fsync(file.fileno())
                try:
                    ready.replace(mark)
                except FileNotFoundError:  # the other process has just stopped it, or it came without one
                    write_whole(mark, why)
        sync_folder(self.campaigns)

    def is_stopped(self, campaign: LinkCampaign) -> bool:
        return self._stop_mark(campaign).exists()

    def next_run(self, campaign: LinkCampaign) -> int | None:
        """Which run is the first without a closed log; None after the last."""
        names, logs = self._names(), enumerate(map(campaign.log_name, campaign.runs))
        return next((number for number, log in logs if _end_of(log, names) is None), None)

    def waiting(self) -> Iterator[tuple[LinkCampaign, int]]:
        """Campaign and number of the run that is to be played next, as long as there is something."""
        for campaign in self.accepted():
            while not self.is_stopped(campaign) and (number := self.next_run(campaign)) is not None:
                yield campaign, number

    def part(self, name: str) -> Path:
        return self.runs / f"{name}.part"

    def begin(self, name: str, room: int) -> int:
        """Open a run's log with room for so many bytes, known to the disk before anything is commanded: the run will
        never be begun again. Raises OutputError where that cannot be, or where players died before this log began."""
        if _deaths(name, self._names()) >= DEATHS:
            raise OutputError(
                f"the driving process ended {DEATHS} times before {name} had a line in its log; look at the vehicle's "
                "computer and its supply"
            )
        with _one_sentence(name):
            number = os.open(self.part(name), os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
            try:
                _reserve(number, room)
                sync_folder(self.runs)
            except OSError:
                os.close(number)
                self.part(name).unlink()
                raise
        return number

    def write(self, number: int, name: str, line: str) -> None:
        content = line.encode()
        with _one_sentence(name):
            if os.write(number, content) < len(content):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def close(self, name: str, mark: str) -> None:
        """Close a run's log: its hash beside it, then its name, which nothing changes after that.

        A run that was cut before its log had a line is forgotten: nothing was commanded. Raises OSError."""
        part, log = self.part(name), self.runs / f"{name}{mark}.csv"
        with _opened(part, os.O_RDWR) as file:
            content = file.read()
            complete = content[: content.rfind(b"\n") + 1]  # a power cut may leave half a line
            file.truncate(len(complete))  # also gives back the room that was not needed
            os.fsync(file.fileno())
        if mark and not content:
            part.unlink()
        else:
            with suppress(OutputError):  # without room for it the hash is worked out when it is asked for
                write_whole(_hash_file(log), f"{hashlib.sha256(complete).hexdigest()}  {log.name}\n")
            part.replace(log)
        sync_folder(self.runs)

    def close_leftovers(self) -> None:
        """Close what a player that was killed, or a power cut, left open; for who alone plays.

        An empty log is put aside, and counts as a death."""
        while (name := _playing(names := self._names())) is not None:
            if self.part(name).stat().st_size:
                self.close(name, wire.INTERRUPTED)
            else:
                self.part(name).replace(self.runs / f"{name}.died{_deaths(name, names) + 1}")
                sync_folder(self.runs)

    def log(self, name: str) -> Log | None:
        """A log, a closed one with the hash that it was closed with; None where there is none of that name."""
        with suppress(OSError, SettingError):  # also a file that is too large for a log
            if wire.LOG_NAME.fullmatch(name) and stat.S_ISREG((status := (self.runs / name).lstat()).st_mode):
                closed = name.endswith(".csv")
                return Log(name, status.st_size, closed, self._hash_of(self.runs / name, status) if closed else None)
        return None

    def listing(self) -> Listing:
        names = sorted(name for name in self._names() if name.endswith((".csv", ".part")))
        return Listing(wire.RUNS_SCHEMA, tuple(log for name in names if (log := self.log(name)) is not None))

    def open_log(self, name: str) -> BinaryIO:
        return _opened(self.runs / name)

    def is_playing(self) -> bool:
        return _playing(self._names()) is not None

    def state(self) -> State:
        documents, names = self._documents(), self._names()
        campaigns = (self._state_of(item) if isinstance(item, LinkCampaign) else item for item in documents)
        odd = [item for item in documents if isinstance(item, str)]
        for name, is_file in sorted(names.items()):
            if name.endswith((".csv", ".part")) and not (is_file and wire.LOG_NAME.fullmatch(name)):
                odd.append(f"runs/{printable(name)} is passed over (a link, a folder or no log of ours); move it away")
        states = tuple(state for state in campaigns if isinstance(state, CampaignState))
        return State(wire.STATE_SCHEMA, states, _playing(names), tuple(odd))

    def _documents(self) -> list[LinkCampaign | CampaignState | str]:
        """Each campaign; of one that is over its last state, of a document that is none a sentence."""
        documents = list[LinkCampaign | CampaignState | str]()
        with os.scandir(self.campaigns) as entries:
            files = sorted((file for file in entries if file.name.endswith(".json")), key=lambda file: file.name)
        for entry in files:
            try:
                status = entry.stat(follow_symlinks=False)
                key = _key(entry.name, status)
                document = self._memory.get(key) or _campaign_at(Path(entry), status)
                if isinstance(document, LinkCampaign) and (state := self._state_of(document)).over:
                    document = state
                self._memory[key] = document
            except FileNotFoundError:
                continue
            except OSError as problem:  # may be over soon
                document = f"campaigns/{printable(entry.name)} cannot be read ({problem.strerror or problem})"
            documents.append(document)
        return documents

    def _state_of(self, campaign: LinkCampaign) -> CampaignState:
        why = None
        if self.is_stopped(campaign):
            why = ASKED
            with suppress(OSError), _opened(self._stop_mark(campaign)) as file:
                why = file.read(LONGEST_WHY).decode("utf-8", "replace").strip() or ASKED
        names = self._names()  # after the mark: what is begun after it commands nothing
        logs = [campaign.log_name(run) for run in campaign.runs]
        ends = [_end_of(log, names) for log in logs]
        played = sum(end is not None for end in ends)
        over = played == len(ends) or (why is not None and not any(f"{log}.part" in names for log in logs))
        battery = round(campaign.charge(played), 3) if played else campaign.battery.charge_Ah
        return CampaignState(campaign.id, len(ends), played, ends.count(wire.INTERRUPTED), over, battery, why)

    def _names(self) -> dict[str, bool]:
        with os.scandir(self.runs) as entries:
            return {entry.name: entry.is_file(follow_symlinks=False) for entry in entries}

    def _stop_mark(self, campaign: LinkCampaign) -> Path:
        return self.campaigns / f"{campaign.id}.stopped"

    def _ready(self, campaign: LinkCampaign) -> Path:
        """What becomes the mark, with room for a reason."""
        return self.campaigns / f"{campaign.id}.ready"

    def _hash_of(self, log: Path, status: os.stat_result) -> str:
        key = _key(log.name, status)
        if key not in self._memory:
            text = ""
            with suppress(OSError), _opened(_hash_file(log)) as file:
                text = file.read(64).decode("ascii", "replace")
            if not wire.SHA256.fullmatch(text):  # a log that somebody put there, or whose hash is damaged
                with _opened(log) as file:
                    text = hashlib.file_digest(file, "sha256").hexdigest()  # type: ignore[arg-type]
            self._memory[key] = text
        return str(self._memory[key])


def _key(name: str, status: os.stat_result) -> tuple[str, int, int]:
    return name, status.st_mtime_ns, status.st_size


def _campaign_at(path: Path, status: os.stat_result) -> LinkCampaign | str:
    """The campaign of a document, or a sentence on one that is none. Raises OSError."""
    why = "it is no file"
    if stat.S_ISREG(status.st_mode):
        try:
            with _opened(path) as file:
                campaign = wire.campaign_in(file.read())
            if path.stem.endswith(f"_{campaign.id}"):
                return campaign
            why = "its bytes are not those that it was accepted with"
        except SettingError as problem:
            why = str(problem)
    return f"campaigns/{printable(path.name)} is passed over ({why[:300]}); move it away"


def _end_of(name: str, names: Collection[str]) -> str | None:
    """How a run ended, its mark; None where it was not played, or is being played."""
    return next((mark for mark in wire.ENDS if f"{name}{mark}.csv" in names), None)


def _deaths(name: str, names: Collection[str]) -> int:
    return sum(other.startswith(f"{name}.died") for other in names)


def _playing(names: Mapping[str, bool]) -> str | None:
    parts = (name for name in sorted(names) if name.endswith(".part") and names[name] and wire.LOG_NAME.fullmatch(name))
    return next((name.removesuffix(".part") for name in parts), None)


def _hash_file(log: Path) -> Path:
    return log.with_name(f"{log.name}.sha256")


def _opened(path: Path, flags: int = os.O_RDONLY) -> BinaryIO:
    """A file that is there, and no link."""
    number = os.open(path, flags | NO_LINKS | getattr(os, "O_BINARY", 0))
    return os.fdopen(number, "rb" if flags == os.O_RDONLY else "wb" if flags == os.O_WRONLY else "r+b")


@contextmanager
def _one_sentence(name: str) -> Iterator[None]:
    """Trouble with the disk becomes an OutputError that names the log."""
    try:
        yield
    except OSError as problem:
        why = problem.strerror or str(problem)
        raise OutputError(f"{name} cannot be logged ({why}); make room on the vehicle's disk, then plan anew") from None


def _reserve(number: int, size: int) -> None:
    """Keep room on the disk for `size` bytes of an open file, whose length stays. Raises OSError where there is none.

    Source: fallocate(2). Where the system or the disk cannot keep any, there must be so much now."""
    if sys.platform == "linux":
        library = ctypes.CDLL(None, use_errno=True)
        allocate = getattr(library, "fallocate64", None) or library.fallocate
        if allocate(number, KEEP_SIZE, ctypes.c_longlong(0), ctypes.c_longlong(size)) == 0:
            return
        if (code := ctypes.get_errno()) not in (errno.EOPNOTSUPP, errno.ENOSYS):
            raise OSError(code, os.strerror(code))
    if hasattr(os, "fstatvfs"):
        disk = os.fstatvfs(number)
        if disk.f_bavail * disk.f_frsize < size:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


class HeldElsewhereError(Exception):
    pass


@contextmanager
def held(path: Path) -> Iterator[None]:
    """Hold the lock file `path`, which the system frees when its holder ends, however it ends.

    Raises HeldElsewhereError at once, or OSError."""
    with path.open("w") as file:
        if sys.platform != "win32":
            import fcntl

            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise HeldElsewhereError from None
        yield


def sync_folder(folder: Path) -> None:
    """See that the names in a folder outlast a power cut, where the system can do that."""
    if os.name != "nt":
        number = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(number)
        finally:
            os.close(number)
