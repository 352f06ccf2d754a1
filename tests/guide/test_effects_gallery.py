"""The gallery of effects says what the library says; run as a program, this writes it anew:
`PYTHONPATH=tests/helpers python tests/guide/test_effects_gallery.py`, and `make pictures` draws what it shows."""

from effect_families import families, picture_of
from repository import ROOT

from automarine_cli import guide
from automarine_cli.dofs import DOFS, YAW
from automarine_cli.effects import Effect

PAGE = guide.FOLDER / "effects-gallery.md"
HEAD = """# Gallery of effects: what each looks like in the data

[`diagnose`](commands/diagnose.md) can name these {count} effects. Each panel is a simulated run without noise: grey
without the effect, blue with it. Without the runs under *best seen in*, a diagnosis may miss the effect.
[`automarine effects NAME`](commands/effects.md) prints equation, parameters, look-alikes and source.
"""
WIDTH = 640


def gallery() -> str:
    """The page as the library has it: a section for each family, with its picture."""
    parts = [HEAD.format(count=sum(map(len, families().values())))]
    for title, members in families().items():
        picture = f"../../.github/pictures/{picture_of(title)}.png"
        image = f'<img src="{picture}" width="{WIDTH}" alt="{title}: runs without and with each effect">'
        rows = "\n".join(map(row, members))
        parts.append(f"## {title}\n\n{image}\n\n|effect|what it is|best seen in|\n|---|---|---|\n{rows}\n")
    return "\n".join(parts)


def row(effect: Effect) -> str:
    card = effect.card(YAW)
    motions = (*effect.motions, *(["plane"] if effect.acts_on else []))
    only = f" ({', '.join(motions)} only)" if len(effect.motions) < len(DOFS) else ""
    return f"|`{card.name}`|{card.says}{only}|{card.reveals}|"


def test_the_gallery_is_made_from_the_library() -> None:
    assert PAGE.read_text(encoding="utf-8") == gallery()
    assert len(gallery().split()) <= 1070


def test_every_effect_has_its_panel() -> None:
    drawn = (ROOT / "tests" / "benchmarks" / "pictures.py").read_text(encoding="utf-8")
    shown = [effect.name for family in families().values() for effect in family]
    assert [name for name in shown if f'"{name}": Panel(' not in drawn] == []


if __name__ == "__main__":
    PAGE.write_text(gallery(), encoding="utf-8")
