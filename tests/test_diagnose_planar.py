"""diagnose of planar models on campaigns of an independent solver: what is hidden is named, nothing is not."""

from functools import cache

import pytest
from made_planar import HIDDEN, campaign

from automarine_cli.diagnosis.planar import PlanarSearch, find_missing
from automarine_cli.fits.planar_structure import observed
from automarine_cli.models.planar import Inertia, PlanarModel
from automarine_cli.models.planar_store import StoredPlanar
from automarine_cli.models.yaw_model import Term

GIVEN = PlanarModel(
    Inertia(18.0, 18.0, 2.2),
    *((Term("quadratic-drag", (drag,)),) for drag in (15.0, 50.0, 3.0)),
)
"""About the bare craft, as somebody would write it down."""
SPEEDS = ("heading", "surge", "sway")


@cache
def searched(kind: str, seed: int = 1, mirror: bool = False) -> PlanarSearch:
    """Three short runs are fitted, one is held out."""
    channels = ("heading", "north", "east") if kind == "current" else SPEEDS
    runs = campaign(HIDDEN[kind], seed, 4, 10.0, channels, mirror)
    return find_missing(StoredPlanar(GIVEN, "by hand"), runs[:3], runs[3:], observed(runs))


@pytest.mark.parametrize(
    ("kind", "added", "truth"),
    [
        ("N_ur", "yaw.N_ur", 2.5),
        ("N_v", "yaw.N_v", 4.0),
        ("Y_r", "sway.Y_r", 4.0),
        ("munk-moment", "sway.m_v", 32.0),
        ("current", "current.north", 0.15),
    ],
)
def test_what_is_hidden_is_named(kind: str, added: str, truth: float) -> None:
    found = searched(kind)
    assert found.verdict == "named"
    (step,) = found.steps
    assert found.named[0].candidate.added[0] == added and not step.rivals
    assert found.after.known[added] == pytest.approx(truth, rel=0.1)


def test_nothing_hidden_nothing_named() -> None:
    found = searched("nothing")
    assert found.verdict == "nothing-missing" and not found.suspected


def test_the_mirrored_campaign_has_the_mirrored_verdict() -> None:
    one, other = (searched("N_v", mirror=mirror) for mirror in (False, True))
    assert [one.candidate.added for one in other.named] == [("yaw.N_v",)]
    assert other.named[0].surplus == pytest.approx(one.named[0].surplus, rel=1e-2)
    assert other.after.known["yaw.N_v"] == pytest.approx(one.after.known["yaw.N_v"], rel=1e-3)
