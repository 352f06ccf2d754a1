"""`make peers`: automarine side by side with what people use today, in one run.

    python tests/benchmarks/peers.py --out DIR [--only fit,names,predict,thrusters] [--jobs N] [--campaigns N]
    python tests/benchmarks/peers.py --page [--out DIR]

The first measures and goes on where it stopped: every cell is kept in DIR/PART.json, the summary in DIR/peers.json. A
peer that is not installed (`pip install --group peers`) is left out; its cells are dashes. The second takes the summary
of DIR, where there is one, as tests/benchmarks/peers.json, and writes the tables of the page *Why not ...?*, the lines
of the README and two figures from it. Measure on cores that have nothing else to do: times are compared.
"""

import contextlib
import importlib
import importlib.util
import io
import json
import platform
import shutil
import sys
import time
import warnings
import zlib
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from importlib import metadata
from pathlib import Path
from types import ModuleType
from typing import Any

import arguments
import blind_frozen
import numpy as np
import peer_automarine
import peers_fit
import peers_names
import peers_page
import peers_predict
import peers_thrusters

from automarine_cli import __version__

Row = dict[str, Any]
PARTS = ("fit", "names", "predict", "thrusters")
NEEDS = {
    "peer_plain": "scipy", "peer_mujoco": "mujoco.sysid", "peer_sindy": "pysindy", "peer_stepwise": "statsmodels",
}  # fmt: skip
NAMING = ("peer_sindy", "peer_stepwise")
SEPARATED = " | "


def installed() -> dict[str, str]:
    """The modules of all tools that can run here, by title; automarine first."""
    there = {peer_automarine.TITLE: "peer_automarine"}
    for module, needed in NEEDS.items():
        with contextlib.suppress(ImportError):
            if importlib.util.find_spec(needed) is not None:
                there[importlib.import_module(module).TITLE] = module
    return there


def peer_of(title: str) -> ModuleType:
    """The module of the tool with that title."""
    return importlib.import_module(installed()[title])


def measured(item: tuple[str, tuple[Any, ...], Path]) -> Row:
    """One cell of a part, or why it has no result; the tool's own printing is dropped."""
    part, cell, out = item
    np.random.seed(zlib.crc32(repr(cell).encode()))  # noqa: NPY002  # PySINDy draws from it
    warnings.simplefilter("ignore")
    begun = time.perf_counter()
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            row = MEASURES[part](cell, out)
    except Exception as failure:  # of a tool of others anything may come
        row = {"failed": f"{type(failure).__name__}: {failure}"[:300]}
    return {**row, "seconds": round(time.perf_counter() - begun, 2)}


def named(cell: tuple[Any, ...], out: Path) -> Row:
    """What a tool says is missing in a campaign."""
    title, campaign = cell
    place = out / "blind" / "campaigns" / campaign
    peer = peer_of(title)
    return dict(blind_frozen.answer_of(place) if peer is peer_automarine else peer.answer(place))


MEASURES: dict[str, Callable[[tuple[Any, ...], Path], Row]] = {
    "fit": lambda cell, out: peers_fit.fitted(cell, peer_of(cell[0])),
    "names": named,
    "predict": lambda cell, out: peers_predict.predicted(cell, peer_of(cell[0])),
    "thrusters": lambda cell, out: peers_thrusters.left_out(cell),
}


def cells_of(part: str, out: Path, campaigns: int) -> Sequence[tuple[Any, ...]]:
    """All cells of a part, of the tools that are installed."""
    every = installed()
    titles = list(every)
    if part == "fit":
        return peers_fit.cells(titles, campaigns)
    if part == "names":
        naming = [title for title, module in every.items() if module in ("peer_automarine", *NAMING)]
        return [(title, name) for title in naming for name in peers_names.write(out / "blind")]
    return peers_predict.cells(titles) if part == "predict" else peers_thrusters.cells()


def measure(part: str, out: Path, jobs: int, campaigns: int) -> None:
    """Measure what is left of a part."""
    path = out / f"{part}.json"
    done: dict[str, Any] = json.loads(path.read_text()) if path.exists() else {}
    left = {SEPARATED.join(map(str, cell)): cell for cell in cells_of(part, out, campaigns)}
    left = {key: cell for key, cell in left.items() if key not in done}
    begun = time.perf_counter()
    with ProcessPoolExecutor(jobs) as pool:
        waiting = {pool.submit(measured, (part, cell, out)): key for key, cell in left.items()}
        for number, future in enumerate(as_completed(waiting), 1):
            done[waiting[future]] = future.result()
            arguments.write_json(path, dict(sorted(done.items())))
            print(f"{part} {number}/{len(left)} {waiting[future]}", file=sys.stderr, flush=True)
    if part == "fit":  # alone, for a fair clock
        for title in installed():
            for runs in peers_fit.SIZES:
                if (key := SEPARATED.join(("time", title, str(runs)))) not in done:
                    done[key] = peers_fit.timed(title, peer_of(title), runs)
                    arguments.write_json(path, dict(sorted(done.items())))
    print(f"{part}: {time.perf_counter() - begun:.0f} s", file=sys.stderr, flush=True)


def summary(out: Path) -> Row:
    """All that the page shows, of the parts that are there."""
    titles = list(installed())
    peers = {title: peer_of(title) for title in titles}
    parts = {part: json.loads((out / f"{part}.json").read_text()) for part in PARTS if (out / f"{part}.json").exists()}
    result: Row = {
        "schema": "automarine/peers/1",
        "python": platform.python_version(),
        "versions": {
            title: __version__ if peer is peer_automarine else f"{peer.PACKAGE} {metadata.version(peer.PACKAGE)}"
            for title, peer in peers.items()
        },
        "given": {title: peer.GIVEN for title, peer in peers.items()},
        "given thrusters": peers_thrusters.GIVEN,
        "lines": {title: peers_fit.lines_of(peer) for title, peer in peers.items()},
    }
    if done := parts.get("fit"):
        taken = {key.split(SEPARATED)[1]: dict[str, float]() for key in done if key.startswith("time")}
        for key, seconds in done.items():
            if key.startswith("time"):
                _, title, runs = key.split(SEPARATED)
                taken[title][runs] = round(float(np.median(seconds)), 2)
        result["fit"] = {"rows": peers_fit.summary(done, titles), "seconds": taken}
    if done := parts.get("names"):
        key = peers_names.write(out / "blind")
        said: dict[str, dict[str, Row]] = {title: {} for title in titles}
        for each, row in done.items():
            title, campaign = each.split(SEPARATED)
            said[title][campaign] = row
        result["names"] = {title: peers_names.summary(some, key) for title, some in said.items() if some}
    if done := parts.get("predict"):
        result["predict"] = peers_predict.summary(done, list(installed()))
    if done := parts.get("thrusters"):
        result["thrusters"] = peers_thrusters.summary(done)
    return result


def main() -> None:
    chosen = arguments.options(__doc__, out=Path("out/peers"), only=",".join(PARTS), jobs=2, campaigns=10, page=False)
    if chosen.page:
        if (chosen.out / "peers.json").exists():
            shutil.copyfile(chosen.out / "peers.json", peers_page.RESULTS)
        peers_page.write()
        return
    chosen.out.mkdir(parents=True, exist_ok=True)
    for part in chosen.only.split(","):
        if part not in PARTS:
            sys.exit(f"no part {part!r}; there are {', '.join(PARTS)}")
        measure(part, chosen.out, chosen.jobs, chosen.campaigns)
        arguments.write_json(chosen.out / "peers.json", summary(chosen.out))
    print(peers_page.tables_text(summary(chosen.out)))


if __name__ == "__main__":
    main()
