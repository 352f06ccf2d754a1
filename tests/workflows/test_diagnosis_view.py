"""What Python shows of a diagnosis."""

from types import SimpleNamespace

import pytest

from automarine_cli.diagnosis.verdict import NamedEffect
from automarine_cli.report import diagnosis_tables
from automarine_cli.results.estimate import Estimate
from automarine_cli.workflows.diagnose import YawDiagnosis, diagnose


def test_an_effect_is_shown_in_the_words_of_the_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """The law by its name, and nothing of what was held or belongs to laws that do not hold."""
    values = {"chi": 0.15, "T_w": 10.2, "law": 0.0, "tau_ref": 1.2, "calm": 1.0}
    parameters = {name: Estimate(value, 0.01, (value - 0.02, value + 0.02), "1") for name, value in values.items()}
    effect = NamedEffect("water-swirl", "linear", "It swirls.", parameters, 1.0, 0.0005, ())
    monkeypatch.setattr(diagnosis_tables, "verdict_sentence", lambda diagnosis: "Named")
    result = SimpleNamespace(diagnosis=SimpleNamespace(effects=(effect,)))
    shown = [line.split() for line in diagnose.views[YawDiagnosis].lines(result)]
    assert shown[1:3] == [["water-swirl,", "confidence", "100%"], ["chi", "0.150", "[0.130,", "0.170]", "1"]]
    assert ["law", "linear", "1"] in shown and {line[0] for line in shown[2:]} == {"chi", "T_w", "law"}
