"""Everything that a campaign of each motion prints and writes speaks of that motion only.

A campaign of each motion goes through the commands, with runs, files and columns that are called as another motion's
words are. What comes out, on the terminal and in every file, holds these names unchanged and no word, unit or symbol of
another motion beside them.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
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
TRANSLATION = "cm force forces mass distance distances depth depths"
OWN: Mapping[str, str] = {
    "surge": "surge astern X_u X_uu m_u",
    "sway": "sway Y_v Y_vv m_v",
    "heave": "heave Z_w Z_ww m_w buoyancy ballast",
}
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
    """Any whole word, unit or symbol that belongs to another motion only."""
    words = set((TRANSLATION if dof.wraps else ROTATION).split())
    words |= {word for name, own in OWN.items() if name != dof.name for word in own.split()}
    words |= {"distance", "distances", "depth", "depths", "port", "starboard"}
    words -= {*SHARED[dof.name].split(), *OWN.get(dof.name, "").split()}
    return re.compile("|".join(whole(word) for word in sorted(words, key=len, reverse=True)))


def whole(word: str) -> str:
    """The word as such, also with a capital or as part of a key: no part of a longer word."""
    before = r"(?<![A-Za-z-])" if word[0].isascii() and word[0].isalpha() else ""
    after = r"(?![A-Za-z|-])" if word[-1].isascii() and word[-1].isalpha() else ""
    first = f"[{word[0].upper()}{word[0].lower()}]" if len(word) > 3 and word[0].isalpha() else re.escape(word[0])
    return before + first + re.escape(word[1:]) + after


def texts(folder: Path) -> Iterator[tuple[str, str]]:
    """Every file of a result as text: tables of Parquet by their columns, vectors and pages by what they show."""
    for path in sorted(folder.rglob("*")):
        if path.suffix == ".parquet":
            table = pq.read_table(path)
            strings = [value for column in table.to_pydict().values() for value in column if isinstance(value, str)]
            yield path.name, "\n".join([*table.column_names, *strings])
        elif path.suffix in (".svg", ".html"):
            text = path.read_text(encoding="utf-8")
            text = re.sub(r"(?s)<(style|script|metadata)\b.*?</\1>", " ", text)
            yield path.name, unescape(re.sub(r"<[^>]*>", "\n", text))
        elif path.is_file() and path.suffix != ".png":
            yield path.name, path.read_text(encoding="utf-8").partition("@dataclass")[0]  # then the library's own code


def strange(text: str, dof: Dof, given: tuple[str, ...]) -> list[str]:
    """The words of other motions in a text, each with what is around it; names that people gave are taken out first."""
    for name in sorted({*given, *OF_NAMES}, key=len, reverse=True):
        text = re.sub(rf"(?<![A-Za-z]){re.escape(name)}(?![A-Za-z])", "·", text)
    return [
        text[max(0, found.start() - 50) : found.end() + 30].replace("\n", " ")
        for found in foreign_to(dof).finditer(text)
    ]


@dataclass(frozen=True)
class Campaign:
    """What a campaign of one motion printed, and the folder of all that it wrote."""

    dof: Dof
    said: Mapping[str, str]
    out: Path
    given: tuple[str, ...]


def spoiled(log: pd.DataFrame, dof: Dof) -> Iterator[tuple[str, pd.DataFrame]]:
    """Logs that do not serve, each for another reason."""
    (position,) = (name for name, _ in dof.columns[dof.position] if name in log)
    stuck, against = log.copy(), log.copy()
    stuck[position] = log[position].iloc[0]
    against[position] = -log[position]
    yield "stuck", stuck
    if not dof.has_constant:  # under a constant force a vehicle may well move against a small command
        yield "against", against
    yield "short", log.iloc[: len(log) // 4]
    yield "moving", log.iloc[len(log) // 3 :]


def odd_logs(dof: Dof, folder: Path) -> tuple[str, ...]:
    """Logs of a motion under names of others, with a column that is called like another's; the names given."""
    folder.mkdir()
    files = sorted((SAMPLE_RUNS / STEPS[dof.name]).glob("*"))
    tables = [log for file in files for log in runs_of(file)]
    column = COLUMN[dof.wraps]
    steps = [log for log in tables if log.filter(regex="^(tau|force|[XYZ]$)").iloc[:, 0].nunique() <= 2]
    chosen = steps[:: max(1, len(steps) // len(NAMES))][: len(NAMES)]
    for name, log in zip(NAMES, chosen):
        log.assign(**{column: range(len(log))}).to_csv(folder / f"{name}.csv", index=False)
    for name, log in spoiled(chosen[-1], dof):
        log.assign(**{column: 0.0}).to_csv(folder / f"{name}.csv", index=False)
    return (*NAMES, column)


def runs_of(file: Path) -> list[pd.DataFrame]:
    """The runs of a file of logs, whatever its format."""
    table = pd.read_parquet(file) if file.suffix == ".parquet" else pd.read_csv(file, comment="#")
    if "run" not in table:
        return [table]
    return [part.drop(columns="run") for _, part in table.groupby("run", sort=False)]


FEW = ("tether-spring", "bias-moment", "dead-band", "saturation", "thruster-lag", "linear-drag")
"""A diagnosis of surge and one of yaw try every effect; the others these."""


@pytest.fixture(scope="module", params=sorted(DOFS))
def campaign(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    """A campaign of each motion: every step and the report, then every export and every card of an effect."""
    dof = DOFS[request.param]
    place = tmp_path_factory.mktemp(dof.name)
    given = odd_logs(dof, place / "logs")
    section = "logs" if dof.wraps else dof.name
    held = [f"logs/{name}.csv" for name in NAMES[:3]]
    fitted = [f"logs/{path.name}" for path in sorted((place / "logs").iterdir()) if path.stem not in NAMES[:3]]
    text = (
        f'schema = "automarine/campaign/1"\ntitle = "A day"\n[{section}]\nsteps = {fitted!r}\nvalidation = {held!r}\n'
    )
    (place / "day.toml").write_text(text.replace("'", '"'))
    out, said = place / "out", dict[str, str]()

    def run(*words: str) -> None:
        result = CliRunner().invoke(automarine, words)
        assert not isinstance(result.exception, Exception) or isinstance(result.exception, SystemExit), words
        said[" ".join(words[:2])] = result.output

    with few_candidates(effects.names() if request.param in ("surge", "yaw") else FEW):
        run("run", str(place / "day.toml"), "-o", str(out))
    model = out / dof.name / f"{dof.name}_model.json"
    assert model.is_file(), said
    for target in exports.names():
        if target != "thrusters":
            run("export", str(model), "--to", target, "-o", str(out / f"export_{target}"))
    run("fit-" + dof.name, str(place / "logs" / "port.csv"))
    run("effects", "--motion", dof.name)
    for name in effects.names():
        effect = effects.get(name)
        if effect.acts_in(dof) and not set(effect.needs) & set(DOFS):  # else it is of another motion by its nature
            run("effects", name, "--motion", dof.name)
    said = {call: words.replace(str(place), "") for call, words in said.items()}
    return Campaign(dof, said, out, given)


def test_what_is_printed_is_of_its_motion(campaign: Campaign) -> None:
    wrong = {
        call: found for call, words in campaign.said.items() if (found := strange(words, campaign.dof, campaign.given))
    }
    assert wrong == {}


def test_what_is_written_is_of_its_motion(campaign: Campaign) -> None:
    written = list(texts(campaign.out))
    assert len(written) > 20
    wrong = {name: found for name, text in written if (found := strange(text, campaign.dof, campaign.given))}
    assert wrong == {}


def test_what_people_named_passes_unchanged(campaign: Campaign) -> None:
    text = "\n".join(text for _, text in texts(campaign.out))
    assert [name for name in campaign.given if name not in text] == []
