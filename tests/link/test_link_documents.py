"""Campaign documents: what is taken, what is refused, and the battery that must carry them."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from link_requests import collected
from made_link import BATTERY, MODEL, expected_logs, made_campaign, vehicle_at

from automarine_cli.errors import SettingError
from automarine_cli.link.document import PlannedRun, campaign_in, read_campaign
from automarine_cli.link.store import Store
from automarine_cli.link.vehicles.replay import Replay
from automarine_cli.link.vehicles.simulated import Simulated
from automarine_cli.pipeline.records import to_mapping


def test_a_document_is_read_back_as_it_was_written_and_accepted_once_and_whole(tmp_path: Path) -> None:
    store, campaign = Store(tmp_path), made_campaign()
    store.prepare()
    content = campaign.text.encode()
    assert campaign_in(content) == campaign and campaign_in(content).id == campaign.id
    with pytest.raises(SettingError, match="try again"):
        store.accept(content[:-20], campaign.id)
    assert store.accepted() == []
    assert (store.accept(content, campaign.id), store.accept(content, campaign.id)) == (True, False)
    assert store.accepted() == [campaign]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"runs": []}, "runs has 0 entries; expected 1 to 500"),
        ({"rate_hz": 1e9}, "rate_hz is 1e+09; expected 0.5 to 200"),
        ({"moment_unit": "kg"}, "found \"kg\", expected one of 'nu', 'N m'"),
        ({"schema": "automarine/plan/9"}, "expected one of 'automarine/link-campaign/1'"),
        ({"execute": "rm"}, 'unknown key "execute"'),
    ],
)
def test_what_is_no_campaign_is_refused(change: dict[str, object], says: str) -> None:
    document = to_mapping(made_campaign()) | change
    with pytest.raises(SettingError) as refused:
        campaign_in(json.dumps(document).encode())
    assert says in str(refused.value)


@pytest.mark.parametrize("name", ["../up", "a/b", "", ".hidden", "a" * 101, "run_stopped", "a\n", "é"])
def test_names_that_could_lead_astray_are_refused(name: str) -> None:
    with pytest.raises(SettingError, match="name is"):
        PlannedRun(name, ((0.5, 1.0),))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_moments_beyond_what_the_battery_is_known_for_are_refused(side: float) -> None:
    with pytest.raises(SettingError, match=r"run 'a' has a moment of 1.5; expected 1 at most"):
        replace(made_campaign(), runs=(PlannedRun("a", ((side * 1.5, 1.0),)),))


def test_the_paper_s_battery_carries_an_hour_and_a_half_at_a_quarter_of_the_thrust() -> None:
    """24 V, two batteries of 12 V and 2.9 Ah: 2.9 Ah in 1.5 h are 1.933 A, here at a quarter of the moment."""
    idle, quarter = 0.3, 0.25**1.5
    spent = replace(BATTERY, full_A=(2.9 / 1.5 - idle) / quarter, reserve_percent=0.0)
    runs = tuple(PlannedRun(f"{i:02d}", ((0.25 * (-1) ** i, 600.0),)) for i in range(10))
    campaign = replace(made_campaign(), battery=spent, rest_s=0.0, runs=runs[:9])  # nine times ten minutes
    assert campaign.charge(9) == pytest.approx(0.0, abs=1e-9)
    replace(campaign, battery=replace(spent, charge_Ah=2.9001)).refuse_beyond_reserve()
    for change, says in (
        ({"charge_Ah": 2.9001}, "in run 10 of 10, 09, it falls to -0.322 Ah of 2.9001, below the reserve"),
        ({"reserve_percent": 20.0}, "in run 8 of 10, 07, it falls to 0.322 Ah of 2.9, below the reserve of 0.58 Ah"),
    ):
        with pytest.raises(SettingError, match=says):
            replace(campaign, battery=replace(spent, **change), runs=runs).refuse_beyond_reserve()


def test_a_vehicle_refuses_moments_of_another_unit_and_runs_that_were_not_recorded(tmp_path: Path) -> None:
    campaign = replace(made_campaign(), moment_unit="N m")
    with pytest.raises(SettingError, match="moments are in N m, the vehicle's model is in nu"):
        Simulated(MODEL).refuse(campaign)
    with pytest.raises(SettingError, match="holds no logs of the run 01_step"):
        Replay(tmp_path).refuse(campaign)


def test_recorded_runs_are_replayed_byte_for_byte(tmp_path: Path) -> None:
    campaign = made_campaign(2)
    for name, content in expected_logs(campaign).items():
        (tmp_path / name).write_bytes(content)
    replay = Replay(tmp_path, speed=1e9)
    replay.refuse(campaign)
    again = ["".join(replay.drive(campaign, number, lambda: False)).encode() for number in range(2)]
    assert again == list(expected_logs(campaign).values())
    assert list(replay.drive(campaign, 0, lambda: True)) == []


def test_the_surface_refuses_what_the_vehicle_refuses(tmp_path: Path) -> None:
    refused = pytest.raises(SettingError, match="the vehicle refuses: the campaign's moments are in N m")
    with vehicle_at(tmp_path / "vehicle") as vehicle, refused:
        collected(vehicle.url, tmp_path / "pool", replace(made_campaign(), moment_unit="N m"))
    plan = tmp_path / "plan.json"
    plan.write_text(json.dumps({"schema": "automarine/plan/1", "moment_unit": "nu"}))
    with pytest.raises(SettingError, match=r'limits\.logger: key "rate_hz" is missing; give a file as `automarine'):
        read_campaign(plan)
