"""The vehicle's folder: campaigns that were accepted, logs that were closed, and the marks between its two processes.

A document or a log is written beside its place, sent to the disk and renamed, and never changes then. What became of
each run stands in its campaign's record, apart from the logs. What must work on a full disk is a rename, or a byte
written over another. Links are not followed; strange files are passed over, and told."""

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
from typing import Any, BinaryIO, NamedTuple

from automarine_cli.errors import OutputError, SettingError
from automarine_cli.link import document as wire
from automarine_cli.link.document import CampaignState, LinkCampaign, Listing, Log, State
from automarine_cli.pipeline.results_folder import put_whole, write_whole
from automarine_cli.text import printable

ASKED_TO_STOP = "asked to stop"
LONGEST_WHY = 1000  # bytes in a campaign's record for its reason to stop; a mark for each run follows them
MAX_DEATHS = 3  # ends of the player's process before a run's log has a line; then the run is not begun again
NEW, DRIVEN = "0123456789"[: MAX_DEATHS + 1], "d"  # marks: never commanded, by its deaths; first command sent
MARKS = {wire.WHOLE: "w", wire.STOPPED: "s", wire.INTERRUPTED: "i"}  # of runs that ended
END_OF_MARK = {mark: end for end, mark in MARKS.items()} | {DRIVEN: wire.INTERRUPTED}
NO_LINKS = getattr(os, "O_NOFOLLOW", 0)
KEEP_SIZE = 1  # Linux, linux/falloc.h


class Marks(NamedTuple):
    """Why a campaign was stopped (None: it was not), and a mark for each of its runs."""

    why_stopped: str | None
    marks: str


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
        return self.folder / "campaigns"

    @property
    def lease(self) -> Path:
        return self.folder / "lease"

    def prepare(self) -> None:
        try:
            self.runs.mkdir(parents=True, exist_ok=True)
            self.campaigns.mkdir(exist_ok=True)
        except OSError as problem:
            raise OutputError(f"{self.folder} cannot be written to ({problem.strerror}); give another folder") from None

    def accepted(self) -> list[LinkCampaign]:
        return [document for document in self._documents() if isinstance(document, LinkCampaign)]

    def accept(
        self, content: bytes, name: str, refuse: Callable[[LinkCampaign], object] = lambda _: None,
        is_late: Callable[[], bool] = lambda: False,
    ) -> bool:  # fmt: skip
        """Keep a campaign whose document has the hash `name`, stopped if it `is_late`; False where it is here.

        For one caller at a time. Raises SettingError for a wrong document, OutputError without room for it."""
        if (digest := hashlib.sha256(content).hexdigest()) != name:
            raise SettingError(f"the campaign has the SHA-256 {digest[:12]}..., not {name[:12]}...; try again")
        there = [path.stem.rpartition("_")[2] for path in self._filed("*.json")]
        if name in there:
            return False
        campaign = wire.campaign_in(content)
        if campaign.text.encode() != content:
            raise SettingError("the campaign is not written as `automarine collect` writes it; use that to send it")
        refuse(campaign)
        campaign.refuse_beyond_reserve()
        if any(other[: wire.ID_LETTERS] == name[: wire.ID_LETTERS] for other in there):
            raise SettingError("another campaign here has an id that begins alike; make the plan with another --seed")
        ready, stopped = self._records(name)
        is_new = not (ready.exists() or stopped.exists())  # that of a document which was deleted stays in force
        document = self.campaigns / f"{len(there) + 1:04d}_{name}.json"
        try:
            if is_new:
                put_whole(ready, " " * LONGEST_WHY + NEW[0] * len(campaign.runs))
            if is_late():
                self.stop(ASKED_TO_STOP, [name])
            put_whole(document, campaign.text)
            sync_folder(self.campaigns)
        except OSError as problem:
            if is_new:
                ready.unlink(missing_ok=True)
            disk = f"the vehicle's disk does not take the campaign ({problem.strerror})"
            raise OutputError(f"{disk}; make room on that disk, then send it again") from None
        self._memory[_key(document.name, document.lstat())] = campaign
        return True

    def stop(self, why: str = ASKED_TO_STOP, only: Collection[str] | None = None) -> None:
        """Stop every campaign, or `only` some, for good: rename their records. Raises OSError if that fails."""
        for ready in self._filed("*.ready"):
            if only is None or ready.stem in only:
                with suppress(OSError):
                    _overwrite(ready, 0, why.encode()[:LONGEST_WHY].ljust(LONGEST_WHY))
                with suppress(FileNotFoundError):  # the other process has just stopped it
                    ready.replace(ready.with_suffix(".stopped"))
        sync_folder(self.campaigns)

    def bar(self, campaign: LinkCampaign, number: int) -> str:
        """Say what on the disk forbids a run: its campaign is damaged or stopped, or it ended; else nothing."""
        document, record = next(iter(self._filed(f"*_{campaign.id}.json")), None), self._record(campaign)
        try:
            intact = document is not None and isinstance(self._read(document, document.lstat()), LinkCampaign)
        except OSError:
            intact = False
        if not intact or record is None:
            return "its document or its record in campaigns/ is damaged or gone; make a plan with another seed"
        if record.why_stopped is not None:
            return record.why_stopped
        return f"run {campaign.runs[number].name} was driven before" if record.marks[number] in MARKS.values() else ""

    def next_run(self, campaign: LinkCampaign) -> int | None:
        """Which run is the first that did not end; None after the last."""
        record = self._record(campaign)
        ends = [] if record is None else _ends(campaign, record, self._names())
        return ends.index(None) if None in ends else None

    def resumed(self) -> tuple[str, ...]:
        """Say which campaigns are not over, for a new player goes on with them at once."""
        says = list[str]()
        for campaign in self.accepted():
            record = self._record(campaign)
            marks = "" if record is None or record.why_stopped is not None else record.marks
            if pending := sum(mark in NEW for mark in marks):
                goes_on = f"it goes on with the last {pending} of its {len(campaign.runs)} runs"
                says.append(f"campaign {campaign.id[: wire.ID_LETTERS]} was not over when serve started: {goes_on}")
        return tuple(says)

    def part(self, name: str) -> Path:
        return self.runs / f"{name}.part"

    def begin(self, name: str, room: int) -> int:
        """Open a run's log with room for so many bytes, known to the disk before anything is commanded.

        Raises OutputError where that cannot be, or where players died before this log had a line."""
        with _one_sentence(name):
            if self._place(name)[2] == NEW[-1]:
                raise OutputError(
                    f"the driving process ended {MAX_DEATHS} times before {name} had a line in its log; look at the "
                    "vehicle's computer and its supply"
                )
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
        """Add a line to a run's log. Before the first the run is marked as driven: it will never be begun again."""
        content, status = line.encode(), os.fstat(number)
        with _one_sentence(name):
            if not status.st_nlink:
                raise FileNotFoundError(errno.ENOENT, "its file was deleted")
            if not status.st_size:
                self._mark(name, DRIVEN)
            if os.write(number, content) < len(content):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def close(self, name: str, end: str) -> None:
        """Close a run's log: its hash beside it, the run's mark, then its name. A log cut before its first line is
        deleted: nothing was commanded. Raises OSError."""
        part, log = self.part(name), self.runs / f"{name}{end}.csv"
        with _opened(part, os.O_RDWR) as file:
            content = file.read()
            complete = content[: content.rfind(b"\n") + 1]  # a power cut may leave half a line
            file.truncate(len(complete))  # also gives back the room that was not needed
            os.fsync(file.fileno())
        if end and not content:
            part.unlink()
        else:
            with suppress(OutputError):  # without room for it the hash is worked out when it is asked for
                write_whole(_hash_file(log), f"{hashlib.sha256(complete).hexdigest()}  {log.name}\n")
            with suppress(FileNotFoundError):  # where the campaign is gone, nothing drives its runs
                self._mark(name, MARKS[end])
            part.replace(log)
        sync_folder(self.runs)

    def close_leftovers(self) -> None:
        """Close what a killed player or a power cut left open; an empty log counts as a death."""
        while (name := _playing(self._names())) is not None:
            if not self.part(name).stat().st_size:
                with suppress(FileNotFoundError, ValueError):  # a run whose first line was lost stays driven
                    self._mark(name, NEW[NEW.index(self._place(name)[2]) + 1])
            self.close(name, wire.INTERRUPTED)

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
        return not self.runs.is_dir() or _playing(self._names()) is not None

    def state(self) -> State:
        documents, names = self._documents(), self._names()
        campaigns = (self._state_of(item) if isinstance(item, LinkCampaign) else item for item in documents)
        odd = [item for item in documents if isinstance(item, str)]
        documented = {path.stem.rpartition("_")[2] for path in self._filed("*.json")}
        stopped = {path.stem for path in self._filed("*.stopped")}
        odd += [f"the document of campaign {name[: wire.ID_LETTERS]} is gone" for name in sorted(stopped - documented)]
        absent = [place.name for place in (self.campaigns, self.runs) if not place.is_dir()]
        odd += [f"{name}/ is gone, and nothing is driven; start `automarine serve` again" for name in absent]
        for name, is_file in sorted(names.items()):
            if name.endswith((".csv", ".part")) and not (is_file and wire.LOG_NAME.fullmatch(name)):
                odd.append(f"runs/{printable(name)} is passed over (a link, a folder or no log of ours); move it away")
        states = tuple(state for state in campaigns if isinstance(state, CampaignState))
        return State(wire.STATE_SCHEMA, states, _playing(names), tuple(odd))

    def _documents(self) -> list[LinkCampaign | CampaignState | str]:
        """Each campaign; of one that is over its last state, of a document that is none a sentence."""
        documents = list[LinkCampaign | CampaignState | str]()
        for path in self._filed("*.json"):
            try:
                status = path.lstat()
                document = self._read(path, status)
                if isinstance(document, LinkCampaign):
                    if (state := self._state_of(document)) is None:
                        document = _passed_over(path, "its record is missing or damaged")
                    elif state.over:
                        document = self._memory[_key(path.name, status)] = state
            except FileNotFoundError:
                continue
            except OSError as problem:  # may be over soon
                document = f"campaigns/{printable(path.name)} cannot be read ({problem.strerror or problem})"
            documents.append(document)
        return documents

    def _read(self, path: Path, status: os.stat_result) -> LinkCampaign | CampaignState | str:
        """What a document was read as. Raises OSError."""
        key = _key(path.name, status)
        if key not in self._memory:
            self._memory[key] = _campaign_at(path, status)
        return self._memory[key]

    def _state_of(self, campaign: LinkCampaign) -> CampaignState | None:
        """How far a campaign is; None where its record is missing or damaged."""
        if (record := self._record(campaign)) is None:
            return None
        names = self._names()  # after the record: what is begun after a stop commands nothing
        ends, why = _ends(campaign, record, names), record.why_stopped
        played = sum(end is not None for end in ends)
        is_open = any(f"{campaign.log_name(run)}.part" in names for run in campaign.runs)
        over = played == len(ends) or (why is not None and not is_open)
        battery = round(campaign.charge(played), 3) if played else campaign.battery.charge_Ah
        return CampaignState(campaign.id, len(ends), played, ends.count(wire.INTERRUPTED), over, battery, why)

    def _filed(self, pattern: str) -> list[Path]:
        """Files in campaigns/, none where the folder goes as it is read: glob raises there until Python 3.13."""
        with suppress(FileNotFoundError):
            return sorted(self.campaigns.glob(pattern))
        return []

    def _names(self) -> dict[str, bool]:
        with suppress(FileNotFoundError), os.scandir(self.runs) as entries:
            return {entry.name: entry.is_file(follow_symlinks=False) for entry in entries}
        return {}

    def _records(self, campaign_id: str) -> tuple[Path, Path]:
        """Where a campaign's record is, before and after it is stopped."""
        return self.campaigns / f"{campaign_id}.ready", self.campaigns / f"{campaign_id}.stopped"

    def _record(self, campaign: LinkCampaign) -> Marks | None:
        """What a campaign's record says; None where it is missing or damaged."""
        ready, stopped = self._records(campaign.id)
        for path in (ready, stopped):  # in this order: it may be renamed in between
            with suppress(OSError), _opened(path) as file:
                why, marks = file.read(LONGEST_WHY), file.read().decode("ascii", "replace")
                if len(marks) != len(campaign.runs) or not {*marks} <= {*NEW, *END_OF_MARK}:
                    return None
                return Marks(None if path == ready else why.decode("utf-8", "replace").strip() or ASKED_TO_STOP, marks)
        return None

    def _place(self, name: str) -> tuple[LinkCampaign, int, str]:
        """Campaign, number and mark of the run that a log is of. Raises FileNotFoundError where nobody knows."""
        for campaign in self.accepted():
            for number, run in enumerate(campaign.runs):
                if campaign.log_name(run) == name and (record := self._record(campaign)) is not None:
                    return campaign, number, record.marks[number]
        raise FileNotFoundError(errno.ENOENT, "its campaign is damaged or gone")

    def _mark(self, name: str, mark: str) -> None:
        """Keep what became of a run, on the disk itself. Raises OSError."""
        campaign, number, _ = self._place(name)
        ready, stopped = self._records(campaign.id)
        try:
            _overwrite(ready, LONGEST_WHY + number, mark.encode())
        except FileNotFoundError:
            _overwrite(stopped, LONGEST_WHY + number, mark.encode())

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
    return name, status.st_ctime_ns, status.st_size


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
    return _passed_over(path, why)


def _passed_over(path: Path, why: str) -> str:
    return f"campaigns/{printable(path.name)} is passed over ({why[:300]}); move it away"


def _ends(campaign: LinkCampaign, record: Marks, names: Collection[str]) -> list[str | None]:
    """How each run ended, by its mark or its log among `names`; None where it was not driven yet, or is just driven."""
    ends = list[str | None]()
    for run, mark in zip(campaign.runs, record.marks):
        log = campaign.log_name(run)
        of_log = next((end for end in wire.RUN_ENDINGS if f"{log}{end}.csv" in names), None)
        ends.append(None if f"{log}.part" in names else END_OF_MARK.get(mark, of_log))
    return ends


def _playing(names: Mapping[str, bool]) -> str | None:
    parts = (name for name in sorted(names) if name.endswith(".part") and names[name] and wire.LOG_NAME.fullmatch(name))
    return next((name.removesuffix(".part") for name in parts), None)


def _hash_file(log: Path) -> Path:
    return log.with_name(f"{log.name}.sha256")


def _opened(path: Path, flags: int = os.O_RDONLY) -> BinaryIO:
    """A file that is there, and no link."""
    number = os.open(path, flags | NO_LINKS | getattr(os, "O_BINARY", 0))
    return os.fdopen(number, "rb" if flags == os.O_RDONLY else "wb" if flags == os.O_WRONLY else "r+b")


def _overwrite(path: Path, at: int, content: bytes) -> None:
    """Put bytes over those in a file, on the disk itself, for which it has room. Raises OSError."""
    with _opened(path, os.O_WRONLY) as file:
        file.seek(at)
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


@contextmanager
def _one_sentence(name: str) -> Iterator[None]:
    """Trouble with the disk becomes an OutputError that names the log."""
    try:
        yield
    except OSError as problem:
        why = problem.strerror or str(problem)
        raise OutputError(f"{name} cannot be logged ({why}); make room on the vehicle's disk, then plan anew") from None


def _reserve(number: int, size: int) -> None:
    """Keep room on the disk for an open file, whose length stays. Raises OSError. Source: fallocate(2)."""
    if hasattr(os, "fstatvfs"):  # asked first: ext4 takes all the room there is before it says that it is too little
        disk = os.fstatvfs(number)
        if disk.f_bavail * disk.f_frsize < size:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    if sys.platform == "linux":
        library = ctypes.CDLL(None, use_errno=True)
        allocate = getattr(library, "fallocate64", None) or library.fallocate
        failed = allocate(number, KEEP_SIZE, ctypes.c_longlong(0), ctypes.c_longlong(size))
        if failed and (code := ctypes.get_errno()) not in (errno.EOPNOTSUPP, errno.ENOSYS):
            raise OSError(code, os.strerror(code))


class HeldElsewhereError(Exception):
    pass


@contextmanager
def held(path: Path) -> Iterator[None]:
    """Hold the lock file `path`, freed when its holder ends. Raises HeldElsewhereError at once, or OSError."""
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
