"""Everything that a campaign of each motion prints and writes speaks of that motion only.

Runs, files and columns are called as another motion's words are. What comes out, on the terminal and in every file,
holds these names unchanged and no word, unit or symbol of another motion beside them.
"""

import re
from collections.abc import Iterator
from html import unescape
from pathlib import Path

import pandas as pd
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from few_candidates import few_candidates
from repository import SAMPLE_RUNS

from automarine_cli import effects, exports
from automarine_cli.commands import automarine
from automarine_cli.dofs import DOFS, Dof

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("drawn_figures")]
STEPS = {"yaw": "hidden_one", "surge": "hidden_surge", "heave": "hidden_heave", "sway": "sway"}
FEW = ("tether-spring", "bias-moment", "dead-band", "saturation", "thruster-lag", "linear-drag")
"""A diagnosis of surge tries every effect; the others these."""
NAMES = (
    "port", "turns", "moment", "yaw", "heading_deg", "starboard", "compass", "force", "depth", "ahead", "distance_m",
    "degrees", "half-turn",
)  # fmt: skip
"""What runs and files may be called, whatever their motion."""
COLUMN = {True: "distance_of_the_tug", False: "heading_of_the_tug"}
"""A column beside the motion's own, by whether that is a rotation."""
ROTATION = (
    "yaw heading headings moment moments inertia compass gyro turn turns turned turning half-turn half-turns degree "
    "degrees deg ° clockwise torsional revolution rad I_r k_r k_rr k_r|r| psi tau ψ τ yaw_rate"
)
TRANSLATION = "cm force forces mass"
SIDES = "distance distances depth depths port starboard"
OF_MOTION = {
    "surge": "surge astern X_u X_uu m_u", "sway": "sway Y_v Y_vv m_v",
    "heave": "heave Z_w Z_ww m_w buoyancy ballast", "yaw": "",
}  # fmt: skip
"""Words of one translation alone."""
SHARED = {
    "surge": "distance distances", "sway": "distance distances port starboard", "heave": "depth depths distance",
    "yaw": "port starboard",
}  # fmt: skip
OF_NAMES = (
    *effects.names(), "tau_max", "tau_ref", "inertia.png", "inertia.svg", "start_heading", "fit-yaw", "yaw_model.json",
)  # fmt: skip
"""Names of effects, of their parameters, of files, options and commands, which are the same for every motion."""


def foreign_to(dof: Dof) -> re.Pattern[str]:
    """Any word, unit or symbol of another motion only: as such, with a capital or in a key, never in a longer word."""
    words = {*(TRANSLATION if dof.wraps else ROTATION).split(), *SIDES.split()} - set(SHARED[dof.name].split())
    words |= {word for name, text in OF_MOTION.items() if name != dof.name for word in text.split()}

    def alone(word: str) -> str:
        before = r"(?<![A-Za-z-])" if word[0].isascii() and word[0].isalpha() else ""
        after = r"(?![A-Za-z|-])" if word[-1].isascii() and word[-1].isalpha() else ""
        first = f"[{word[0].upper()}{word[0]}]" if len(word) > 3 and word[0].isalpha() else re.escape(word[0])
        return before + first + re.escape(word[1:]) + after

    return re.compile("|".join(alone(word) for word in sorted(words, key=len, reverse=True)))


def texts(folder: Path) -> Iterator[tuple[str, str]]:
    """Every file of a result as text: tables of Parquet by their columns, vectors and pages by what they show."""
    for path in sorted(folder.rglob("*")):
        if path.suffix == ".parquet":
            table = pq.read_table(path)
            strings = [value for column in table.to_pydict().values() for value in column if isinstance(value, str)]
            yield path.name, "\n".join([*table.column_names, *strings])
        elif path.suffix in (".svg", ".html"):
            text = re.sub(r"(?s)<(style|script|metadata)\b.*?</\1>", " ", path.read_text(encoding="utf-8"))
            yield path.name, unescape(re.sub(r"<[^>]*>", "\n", text))
        elif path.is_file() and path.suffix != ".png":
            yield path.name, path.read_text(encoding="utf-8").partition("@dataclass")[0]  # then the library's own code


def strange(text: str, dof: Dof) -> list[str]:
    """The words of other motions in a text, each with what is around it; names of people are taken out first."""
    for name in sorted({*NAMES, COLUMN[dof.wraps], *OF_NAMES}, key=len, reverse=True):
        text = re.sub(rf"(?<![A-Za-z]){re.escape(name)}(?![A-Za-z])", "·", text)
    around = (text[max(0, word.start() - 50) : word.end() + 30] for word in foreign_to(dof).finditer(text))
    return [words.replace("\n", " ") for words in around]


def write_logs(dof: Dof, folder: Path) -> None:
    """Logs of a motion, every other row of them, under names of others, with a column that is called like another's;
    some do not serve."""
    folder.mkdir()
    tables: list[pd.DataFrame] = []
    for file in sorted((SAMPLE_RUNS / STEPS[dof.name]).glob("*")):
        table = pd.read_parquet(file) if file.suffix == ".parquet" else pd.read_csv(file, comment="#")
        runs = table.groupby("run", sort=False) if "run" in table else [("", table)]
        tables += [run.drop(columns="run", errors="ignore") for _, run in runs]
    steps = [log for log in tables if log.filter(regex="^(tau|force|[XYZ]$)").iloc[:, 0].nunique() <= 2]
    logs = dict(zip(NAMES, (log.iloc[::2] for log in steps[:: max(1, len(steps) // len(NAMES))])))
    last = list(logs.values())[-1]
    (position,) = (name for name, _ in dof.columns[dof.position] if name in last)
    logs |= {"short": last.iloc[: len(last) // 4], "moving": last.iloc[len(last) // 3 :]}
    logs["stuck"] = last.assign(**{position: last[position].iloc[0]})
    if not dof.has_constant:  # under a constant force a vehicle may well move against a small command
        logs["against"] = last.assign(**{position: -last[position]})
    for name, log in logs.items():
        log.assign(**{COLUMN[dof.wraps]: range(len(log))}).to_csv(folder / f"{name}.csv", index=False)


@pytest.mark.parametrize("name", sorted(DOFS))
def test_what_is_printed_and_written_is_of_its_motion(name: str, tmp_path: Path) -> None:
    """A campaign of each motion: every step and the report, then every export and every card of an effect."""
    dof, out, printed = DOFS[name], tmp_path / "out", dict[str, str]()
    write_logs(dof, tmp_path / "logs")
    held = [f"logs/{run}.csv" for run in NAMES[:3]]
    fitted = sorted(f"logs/{path.name}" for path in (tmp_path / "logs").iterdir() if path.stem not in NAMES[:3])
    section = "logs" if dof.wraps else name
    text = f'schema = "automarine/campaign/1"\ntitle = "A day"\n[{section}]\nsteps = {fitted}\nvalidation = {held}\n'
    (tmp_path / "day.toml").write_text(text.replace("'", '"'))

    def run(*words: object) -> None:
        result = CliRunner().invoke(automarine, [str(word) for word in words])
        assert not isinstance(result.exception, Exception) or isinstance(result.exception, SystemExit), words
        printed[" ".join(map(str, words[:2]))] = result.output.replace(str(tmp_path), "")

    with few_candidates(effects.names() if name == "surge" else FEW, curves=False):
        run("run", tmp_path / "day.toml", "-o", out)
    model = out / name / f"{name}_model.json"
    assert model.is_file(), printed
    for target in exports.names():
        if target != "thrusters":
            run("export", model, "--to", target, "-o", out / f"export_{target}")
    run(f"fit-{name}", tmp_path / "logs" / "port.csv")
    run("effects", "--motion", name)
    for effect in map(effects.get, effects.names()):
        if effect.acts_in(dof) and not set(effect.needs) & set(DOFS):  # else it is of another motion by its nature
            run("effects", effect.name, "--motion", name)

    written = list(texts(out))
    assert len(written) > 20
    assert {file: words for file, text in (*printed.items(), *written) if (words := strange(text, dof))} == {}
    everything = "\n".join(text for _, text in written)
    assert [word for word in (*NAMES, COLUMN[dof.wraps]) if word not in everything] == []
