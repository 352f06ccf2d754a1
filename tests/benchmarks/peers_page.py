"""What the page *Why not ...?* and the README show of tests/benchmarks/peers.json: tables, one list, two figures."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from pictures import small_png
from repository import ROOT

Row = dict[str, Any]

RESULTS = ROOT / "tests" / "benchmarks" / "peers.json"
PAGE, README = ROOT / "automarine_cli" / "guide" / "why-not.md", ROOT / "README.md"
PICTURES = ROOT / ".github" / "pictures"
OURS = "automarine"
KINDS = {
    "clean": "clean", "scatter": "thrust scatters by 3 %", "between": "switched between samples",
    "delay": "delay of 0.25 s",
}  # fmt: skip
README_KINDS = {"clean": "equal thrust in all runs", "scatter": "thrust varies by 3 % from run to run"}
SIZES = (12, 24, 72)
NAMELESS = ("suspected", "unexplained", "refused")
MARKS = ("right", "tie", "half", "wrong", "missed")
AHEAD = 0.95
"""Another tool is ahead where its error is below this share of ours."""
SHORT = {"one level in five left out": "1 in 5 left out", "11 levels kept": "11 kept"}
HORIZONS = (2, 5, 15)  # s
OKABE_ITO = {
    OURS: ("#000000", "o"), "plain script": ("#D55E00", "^"), "mujoco.sysid": ("#0072B2", "v"),
    "PySINDy": ("#CC79A7", "D"), "regression": ("#009E73", "X"),
    "polynomial": ("#E69F00", "^"), "monotone spline": ("#0072B2", "v"),
}  # fmt: skip
"""Colours that the colour-blind tell apart, and a marker each."""
HOUSE_BLUE = "#0072B2"


def blocks(found: Row) -> dict[str, str]:
    """What stands under each heading of the page, first table or list."""
    return {
        "Where another tool is ahead": "\n".join(ahead(found)),
        "Fit inertia and drag": fit_table(found),
        "Coverage of intervals": coverage_table(found),
        "Name what is missing": names_table(found),
        "Predict real logs": predict_table(found),
        "Map a thruster": thrusters_table(found),
        "What each tool was given": given_table(found),
    }


def tables_text(found: Row) -> str:
    return "\n\n".join(f"{heading}\n{block}" for heading, block in blocks(found).items() if block)


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    if not rows:
        return ""
    rule = ["---", *["---:" if re.search(r"\d", rows[0][i]) else "---" for i in range(1, len(head))]]
    return "\n".join(f"|{'|'.join(line)}|" for line in (head, rule, *rows))


def number(value: float | None) -> str:
    if value is None or not np.isfinite(value):
        return "-"
    return f"{value:.2f}" if abs(value) < 9.995 else f"{value:.1f}" if abs(value) < 99.95 else f"{value:.0f}"


def pooled(found: Row, tool: str, kind: str) -> dict[str, Row]:
    """Of all numbers of runs together: bias, spread and rms in bounds, coverage in percent, of inertia and drag."""
    rows = [row for row in found["fit"]["rows"] if (row["tool"], row["kind"]) == (tool, kind)]
    out = {}
    for name in ("I_r", "k_rr"):
        every = [(row["campaigns"] - row["failed"], row[name]) for row in rows]
        total = sum(count for count, _ in every)
        if not total:
            continue
        square = sum(count * each["rms"] ** 2 for count, each in every) / total
        bias = sum(count * each["bias"] for count, each in every) / total
        covered = [None if each["coverage"] is None else count * each["coverage"] for count, each in every]
        out[name] = {
            "bias": bias, "sd": float(np.sqrt(max(square - bias**2, 0.0))), "rms": float(np.sqrt(square)),
            "coverage": None if None in covered else sum(map(float, filter(None, covered))) / total,
        }  # fmt: skip
    return out


def fit_tools(found: Row) -> list[str]:
    return list(dict.fromkeys(row["tool"] for row in found["fit"]["rows"]))


COLUMNS = [(kind, name) for kind in KINDS for name in ("I_r", "k_rr")]


def fit_table(found: Row) -> str:
    """A row a tool: bias ± spread in bounds of inertia and drag by kind of campaign; the least rms error is bold."""
    if "fit" not in found:
        return ""
    of = {(tool, kind): pooled(found, tool, kind) for tool in fit_tools(found) for kind in KINDS}
    least = {(kind, name): min(x[name]["rms"] for (_, k), x in of.items() if k == kind and x) for kind, name in COLUMNS}
    rows = []
    for tool in fit_tools(found):
        cells = []
        for kind, name in COLUMNS:
            if not (each := of[tool, kind].get(name)):
                cells.append("-")
                continue
            cell = f"{'-' if each['bias'] < 0 else '+'}{number(abs(each['bias']))}±{number(each['sd'])}"
            cells.append(f"**{cell}**" if number(each["rms"]) == number(least[kind, name]) else cell)
        rows.append([tool, *cells])
    return table(["tool", *(f"{kind}: {name}" for kind, name in COLUMNS)], rows)


def coverage_table(found: Row) -> str:
    """A row a tool and number of runs: coverage in percent of inertia and drag by kind, with the campaigns of each."""
    rows = []
    for tool in fit_tools(found) if "fit" in found else ():
        for size in SIZES:
            of = {r["kind"]: r for r in found["fit"]["rows"] if (r["tool"], r["runs"]) == (tool, size)}
            some = [of[kind][name]["coverage"] if kind in of else None for kind, name in COLUMNS]
            if any(covered is not None for covered in some):
                count = max(row["campaigns"] for row in of.values())
                cells = ("-" if covered is None else f"{covered:.0f}" for covered in some)
                rows.append([tool, str(size), str(count), *cells])
    return table(["tool", "runs", "campaigns", *(f"{kind}: {name}" for kind, name in COLUMNS)], rows)


def names_table(found: Row) -> str:
    rows = [
        [tool, *(str(row[mark]) for mark in MARKS), str(sum(row[mark] for mark in NAMELESS)), str(row["false claims"])]
        for tool, row in found.get("names", {}).items()
    ]  # fmt: skip
    return table(["tool", *MARKS, "no name", "false claims"], rows)


def predict_table(found: Row) -> str:
    worst, rows = HORIZONS.index(5), list[list[str]]()
    for row in found.get("predict", []):
        errors = [*map(number, row["ratio"]), number(row["worst"][worst])]
        rows.append([row["tool"], *errors, *map(str, row["best"]), str(row["failed"])])
    ratios, best = ([form.format(h) for h in HORIZONS] for form in ("{} s: error over the best", "best at {} s"))
    head = ["tool", *ratios, "worst half at 5 s", *best, "failed"]
    return table(head, rows)


def thrusters_table(found: Row) -> str:
    tools = list(found.get("given thrusters", {}))
    rows = [
        [f"{row['table']}, {SHORT[row['left out']]}", *(number(row.get(tool)) for tool in tools)]
        for row in found.get("thrusters", [])
    ]
    return table(["table", *(f"{tool} %" for tool in tools)], rows)


def given_table(found: Row) -> str:
    seconds = found.get("fit", {}).get("seconds", {})
    rows = [
        [tool, found["versions"][tool], number(seconds.get(tool, {}).get("24")), str(found["lines"][tool]), given]
        for tool, given in found["given"].items()
    ]
    rows += [[tool, "-", "-", "-", given] for tool, given in found["given thrusters"].items()]
    return table(["tool", "version", "s for 24 runs", "lines", "settings"], rows)


def ahead(found: Row) -> Iterator[str]:
    """One item each where another tool does better than the tool by default."""
    names = {"I_r": "inertia", "k_rr": "drag"}
    for kind, shown in KINDS.items() if "fit" in found else ():
        for name, said in names.items():
            rms = {tool: of[name]["rms"] for tool in fit_tools(found) if (of := pooled(found, tool, kind))}
            best = min((tool for tool in rms if tool != OURS), key=rms.__getitem__, default=OURS)
            if rms[best] < AHEAD * rms[OURS]:
                both = f"{best} {number(rms[best])} times the least error, automarine {number(rms[OURS])}"
                yield f"- **Fit, {shown}, {said}:** {both}."
    seconds = {tool: taken["24"] for tool, taken in found.get("fit", {}).get("seconds", {}).items() if "24" in taken}
    if seconds and (faster := [t for t in seconds if seconds[t] < AHEAD * seconds[OURS]]):
        said = ", ".join(f"{tool} {number(seconds[tool])} s" for tool in faster)
        yield f"- **Time for 24 runs:** {said}, automarine {number(seconds[OURS])} s without figures."
    if some := found.get("names"):
        for tool, row in some.items():
            if row["right"] > some[OURS]["right"]:
                yield f"- **Names:** {tool} has {row['right']} right, automarine {some[OURS]['right']}."
    rows = {row["tool"]: row for row in found.get("predict", [])}
    for i, horizon in enumerate(HORIZONS) if rows else ():
        best = min(rows, key=lambda tool: rows[tool]["ratio"][i])
        low, mine = (number(rows[tool]["ratio"][i]) for tool in (best, OURS))
        if low != mine:  # as they are shown
            yield f"- **Predict {horizon} s ahead:** {best} {low} times the least error, automarine {mine} (medians)."
    tables = found.get("thrusters", [])
    for tool in found.get("given thrusters", {}):
        if tool != OURS and (won := [row for row in tables if row.get(tool, np.inf) < AHEAD * row[OURS]]):
            yield f"- **Thruster maps:** the {tool} is ahead in {len(won)} of {len(tables)} comparisons."


def readme_lines(found: Row) -> str:
    """A table of one row a question: automarine, and the best of the others; the better one is bold."""
    rows = []
    if "fit" in found:
        for kind in ("clean", "scatter"):
            rms = {t: of["I_r"]["rms"] for t in fit_tools(found) if (of := pooled(found, t, kind))}
            least = min(rms.keys() - {OURS}, key=rms.__getitem__)
            count, fewer = (campaigns(found, tool, kind) for tool in (OURS, least))
            among = f"{count} campaigns" if count == fewer else f"{count} campaigns, other tool {fewer}"
            rows.append([f"error of inertia¹, {README_KINDS[kind]} ({among})", *best_of(rms, "{}")])
    if some := found.get("names"):
        wrong = {tool: (-float(row["right"]), tool) for tool, row in some.items()}
        best = min((tool for tool in wrong if tool != OURS), key=wrong.__getitem__)
        ours, other = (f"{some[t]['right']} right, {some[t]['false claims']} false" for t in (OURS, best))
        ours, other = (ours, f"**{other}**") if wrong[best] < wrong[OURS] else (f"**{ours}**", other)
        rows.append([f"hidden effect named, {some[OURS]['campaigns']} simulated campaigns", ours, f"{best}: {other}"])
    for horizon in (5, 15) if found.get("predict") else ():
        ratio = {row["tool"]: row["ratio"][HORIZONS.index(horizon)] for row in found["predict"]}
        halves = found["predict"][0]["halves"]
        among = f"median of {halves} halves of logs (3 real vehicles, 1 simulated)"
        rows.append([f"error {horizon} s ahead over the best tool's, {among}", *best_of(ratio, "{}")])
    if tables := found.get("thrusters"):
        means = {tool: float(np.mean([row[tool] for row in tables])) for tool in found["given thrusters"]}
        named = len({row["table"] for row in tables})
        said = f"error of a thruster map on levels left out, mean of {len(tables)} splits of {named} bollard tables"
        rows.append([said, *best_of(means, "{} %")])
    return table(["question", OURS, "best other tool"], rows)


def campaigns(found: Row, tool: str, kind: str) -> int:
    """Count what a tool was measured on."""
    return sum(row["campaigns"] for row in found["fit"]["rows"] if (row["tool"], row["kind"]) == (tool, kind))


def best_of(errors: Mapping[str, float], shown: str) -> list[str]:
    """Our error and the least of the others'; the smaller is bold, and both are where they look the same."""
    best = min(errors.keys() - {OURS}, key=errors.__getitem__)
    cells = {tool: shown.format(number(errors[tool])) for tool in (OURS, best)}
    least = cells[min(cells, key=errors.__getitem__)]
    ours, other = (f"**{cell}**" if cell == least else cell for cell in cells.values())
    return [ours, f"{best}: {other}"]


def put(text: str, heading: str, block: str) -> str:
    """The page with its first table, or list, under a heading replaced."""
    mark = "- " if block.startswith("- ") else "|"
    lines = text.split("\n")
    at = lines.index(f"## {heading}")
    end = next((i for i in range(at + 1, len(lines)) if lines[i].startswith("## ")), len(lines))
    first = next(i for i in range(at, end) if lines[i].startswith(mark))
    last = first
    while last < end and lines[last].startswith(mark):
        last += 1
    return "\n".join([*lines[:first], *block.split("\n"), *lines[last:]])


def written(page: str, readme: str, found: Row) -> tuple[str, str]:
    """Both pages with the numbers of the results."""
    for heading, block in blocks(found).items():
        page = put(page, heading, block) if block else page
    return page, put(readme, "Compared with other tools", readme_lines(found).rstrip())


def write() -> None:
    found = json.loads(RESULTS.read_text(encoding="utf-8"))
    page, readme = written(PAGE.read_text(encoding="utf-8"), README.read_text(encoding="utf-8"), found)
    PAGE.write_text(page, encoding="utf-8")
    README.write_text(readme, encoding="utf-8")
    for name, figure in (("peers_fit", fit_figure(found)), ("peers_others", others_figure(found))):
        (PICTURES / f"{name}.png").write_bytes(small_png(figure))


def fit_figure(found: Row) -> Figure:
    """Errors of inertia and drag over the bound, against the number of runs; ours in colour."""
    figure = Figure((8.0, 4.6), layout="constrained")
    drawn = {kind: KINDS[kind] for kind in README_KINDS}
    axes = figure.subplots(2, len(drawn), sharex=True, sharey=True)
    for row, (name, said) in zip(axes, {"I_r": "inertia", "k_rr": "drag"}.items()):
        for ax, (kind, shown) in zip(row, drawn.items()):
            for tool in fit_tools(found):
                some = {
                    r["runs"]: r[name]["rms"] for r in found["fit"]["rows"] if (r["tool"], r["kind"]) == (tool, kind)
                }
                look = (
                    {"color": HOUSE_BLUE, "lw": 4.0, "ms": 9} if tool == OURS else {"color": "0.45", "lw": 1.0, "ms": 5}
                )
                ax.plot(list(some), list(some.values()), marker=OKABE_ITO[tool][1], label=tool, **look)
            ax.axhline(1.0, color="0.6", lw=1, ls="--")
            ax.set(xscale="log", yscale="log", xticks=SIZES, xticklabels=SIZES, ylim=(0.2, 300))
            ax.minorticks_off()
            if name == "I_r":
                ax.set_title(shown, fontsize=10)
            else:
                ax.set_xlabel("runs")
        row[0].set_ylabel(f"rms error of {said}\n[least possible error]\nbetter ↓")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    return figure


def others_figure(found: Row) -> Figure:
    """What was named, and errors of thruster maps."""
    figure = Figure((8.0, 3.9), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.15))
    shades = {"right": "#0072B2", "tie": "#56B4E9", "half": "#F0E442", "wrong": "#D55E00", "missed": "#999999"}
    some = found.get("names", {})
    begin = np.zeros(len(some))
    for mark, colour in shades.items():
        wide = np.array([row[mark] for row in some.values()], dtype=float)
        left.barh(list(some), wide, height=0.5, left=begin, color=colour, edgecolor="white", label=mark)
        begin += wide
    for i, row in enumerate(some.values()):
        left.text(0.0, i - 0.27, f"false claims: {row['false claims']}", fontsize=9, va="bottom")
    left.set(xlabel="campaigns", title="What is missing: named", ylim=(len(some) - 0.5, -0.6))
    rows = found.get("thrusters", [])
    names = [
        row["table"].replace(", ", " ").replace("propeller", "prop.") + (" *" if "kept" in row["left out"] else "")
        for row in rows
    ]
    for tool in found["given thrusters"]:
        colour, marker = OKABE_ITO[tool]
        right.plot([row.get(tool, np.nan) for row in rows], range(len(rows)), marker, color=colour, label=tool)
    right.set(yticks=range(len(rows)), yticklabels=names, xscale="log", title="Thruster maps: levels left out",
              xlabel="rms error [%]; * 11 levels kept", ylim=(len(rows) - 0.5, -0.5))  # fmt: skip
    right.set_xticks([0.3, 1, 3], ["0.3", "1", "3"])
    right.tick_params(axis="y", labelsize=9)
    right.minorticks_off()
    right.grid(axis="y", color="0.9")
    for ax in (left, right):
        ax.legend(loc="upper center", bbox_to_anchor=(0.35, -0.17), ncols=3, frameon=False, fontsize=9)
    return figure
