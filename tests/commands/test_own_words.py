"""What commands print and write of one motion, by the outputs of `tests/golden`, speaks of that motion only; so do the
cards of effects and the exports."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result
from golden import COMMANDS, OUTPUTS
from golden import read as read_outputs

from automarine_cli import effects, exports
from automarine_cli.dofs import DOFS, Dof

ROTATION = (
    "yaw heading headings moment moments inertia compass gyro turn turns turned turning half-turn half-turns degree "
    "degrees deg ° clockwise torsional revolution rad I_r k_r k_rr k_rr psi tau ψ τ yaw_rate"
)
NOT_OF_SWINGS = (
    "yaw heading headings compass turn turns turned turning half-turn half-turns clockwise revolution I_r k_r k_rr "
    "k_rrr psi tau ψ τ yaw_rate cm force forces"
)
TRANSLATION = "cm force forces mass"
SIDES = "distance distances depth depths port starboard"
OF_MOTION = {
    "surge": "surge astern X_u X_uu m_u", "sway": "sway Y_v Y_vv m_v",
    "heave": "heave Z_w Z_ww m_w ballast", "yaw": "", "roll": "roll I_p k_p k_pp heel", "pitch": "pitch I_q k_q k_qq",
}  # fmt: skip
"""Words of one translation alone."""
SHARED = {
    "surge": "distance distances", "sway": "distance distances port starboard", "heave": "depth depths distance",
    "yaw": "port starboard", "roll": "port starboard",
}  # fmt: skip
OF_NAMES = (
    *effects.names(), "tau_max", "tau_ref", "inertia.png", "inertia.svg", "start_heading", "fit-yaw", "yaw_model.json",
    "n_port", "n_stbd", "force_X", "propeller turns", "Basset's force", "y starboard",
)  # fmt: skip
"""Names of effects, of their parameters, of files, options and commands, which are the same for every motion."""


def foreign_to(dof: Dof) -> re.Pattern[str]:
    """Any word, unit or symbol of another motion only: as such, with a capital or in a key, never in a longer word."""
    foreign = NOT_OF_SWINGS if dof.restoring else TRANSLATION if dof.wraps else ROTATION
    words = {*foreign.split(), *SIDES.split()} - set(SHARED[dof.name].split())
    words |= {word for name, text in OF_MOTION.items() if name != dof.name for word in text.split()}

    def alone(word: str) -> str:
        before = r"(?<![A-Za-z-])" if word[0].isascii() and word[0].isalpha() else ""
        after = r"(?![A-Za-z|-])" if word[-1].isascii() and word[-1].isalpha() else ""
        first = f"[{word[0].upper()}{word[0]}]" if len(word) > 3 and word[0].isalpha() else re.escape(word[0])
        return before + first + re.escape(word[1:]) + after

    return re.compile("|".join(alone(word) for word in sorted(words, key=len, reverse=True)))


def strange(text: str, dof: Dof) -> list[str]:
    """The words of other motions in a text, each with what is around it."""
    for name in sorted(OF_NAMES, key=len, reverse=True):
        text = re.sub(rf"(?<![A-Za-z]){re.escape(name)}(?![A-Za-z])", "·", text)
    around = (text[max(0, word.start() - 50) : word.end() + 30] for word in foreign_to(dof).finditer(text))
    return [words.replace("\n", " ") for words in around]


@pytest.mark.parametrize("name", sorted({*DOFS} - {"pitch"}))  # which is roll in other letters
def test_what_is_printed_and_written_is_of_its_motion(name: str, run: Callable[..., Result], tmp_path: Path) -> None:
    dof, texts = DOFS[name], dict[str, str]()
    for line, arguments in COMMANDS.items():
        if line.split("-")[0] in ("fit", "validate", "diagnose") and any(
            Path(word).name.startswith(f"{name}_model") or word == f"fit-{name}" for word in arguments
        ):
            texts |= {f"{line}: {file}": text for file, text in read_outputs(OUTPUTS / f"{line}.txt").items()}
    assert len(texts) > 10
    (model,) = (text for file, text in texts.items() if file.startswith(f"fit-{name}: ") and "_model.json" in file)
    (tmp_path / "model.json").write_text(model)
    for target in set(exports.names()) - {"thrusters"}:
        if run("export", tmp_path / "model.json", "--to", target, "-o", tmp_path / target).exit_code == 0:
            text = (tmp_path / target).read_text(encoding="utf-8")
            texts[target] = text.partition("@dataclass")[0]  # then the library's own code
    assert {"card", "python"} <= set(texts)
    for effect in map(effects.get, effects.names()):
        if effect.acts_in(dof) and not set(effect.needs) & set(DOFS):  # else it is of another motion by its nature
            texts[effect.name] = run("effects", effect.name, "--motion", name).output
    texts["effects"] = run("effects", "--motion", name).output
    assert {file: words for file, text in texts.items() if (words := strange(text, dof))} == {}
