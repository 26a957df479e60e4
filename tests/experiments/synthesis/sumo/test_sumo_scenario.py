"""Scenarios that others made: which files are used, and what is refused."""

import gzip
from pathlib import Path

import pytest

from pd_editor.base.errors import InputError, PdEditorError, SynthesisError
from pd_editor.experiments.synthesis.sumo.sumo_scenario import read_sumo_scenario
from tests.experiments.synthesis.small_city import DEMAND, small_city, write_config


@pytest.fixture
def city(tmp_path: Path) -> Path:
    return small_city(tmp_path / "Bad Aibling (2)")


def test_what_is_used_of_the_files(city: Path):
    net = city / "roads.net.xml"
    packed = city / "roads.net.xml.gz"
    packed.write_bytes(gzip.compress(net.read_bytes()))
    net.unlink()
    write_config(city, "run", "demand.rou.xml", packed.name)
    write_config(city, "few", "", packed.name)
    write_config(city, "old", "demand.rou.xml,lost.rou.xml", packed.name)
    scenario = read_sumo_scenario(city)
    assert scenario.name == "Bad-Aibling-2-"
    assert scenario.span_s == (0.0, 1200.0)
    assert scenario.notes == ()
    tags = {one.tag for root in scenario.files for one in root}
    assert "e1Detector" not in tags
    assert {"vType", "vTypeDistribution", "busStop", "flow", "person"} <= tags
    ids = {one.get("id") for root in scenario.files for one in root}
    assert "tram" not in ids
    assert {"bus", "DEFAULT_VEHTYPE"} <= ids


def test_outputs_of_devices_are_left_out(city: Path):
    text = '<flow id="x" begin="0" end="9" period="3" from="wc" to="ce">'
    text += (
        '<param key="device.ssm.file" value="/nowhere/x"/><param key="a" value="b"/>'
    )
    (city / "demand.rou.xml").write_text(f"<routes>{text}</flow></routes>")
    root = read_sumo_scenario(city).files[-1]
    assert [one.get("key") for one in root.iter("param")] == ["a"]


def test_what_a_network_lacks_is_told(tmp_path: Path):
    scenario = read_sumo_scenario(small_city(tmp_path, signals=False, footways=False))
    name = scenario.name
    assert scenario.notes == (f"{name} has no signals.", f"{name} has no footways.")


@pytest.mark.parametrize(
    ("depart", "seconds"),
    [("3600.5", 3600.5), ("1:00:00", 3600), ("2:00:00:01", 172801)],
)
def test_times_of_departure(city: Path, depart: str, seconds: float):
    text = f'<trip id="a" depart="{depart}" from="wc" to="ce"/>'
    (city / "demand.rou.xml").write_text(f"<routes>{text}</routes>")
    assert read_sumo_scenario(city).span_s == (seconds, seconds)


@pytest.mark.parametrize(
    ("rate", "departs"),
    [
        ('period="4"', [0, 4, 8]),
        ('period="exp(0.25)"', [0, 4, 8]),
        ('perHour="900"', [0, 4, 8]),
        ('number="3"', [0, 4, 8]),
        ('probability="0.5"', [0, 2, 4, 6, 8, 10]),
    ],
)
def test_flows_of_persons_become_persons(city: Path, rate: str, departs: list[float]):
    flow = f'<personFlow id="a" type="t" begin="0" end="12" {rate}><walk from="wc" to="ce"/>'
    (city / "demand.rou.xml").write_text(f"<routes>{flow}</personFlow></routes>")
    persons = list(read_sumo_scenario(city).files[-1])
    assert [float(one.get("depart")) for one in persons] == departs
    assert [one.get("id") for one in persons] == [f"a.{n}" for n in range(len(departs))]
    assert all(one.get("type") == "t" and len(one) == 1 for one in persons)


def refused(city: Path, kind: type[PdEditorError], sentence: str) -> None:
    with pytest.raises(kind, match=sentence) as caught:
        read_sumo_scenario(city)
    assert "\n" not in str(caught.value)


def test_bad_scenarios_are_refused_in_a_sentence(city: Path):
    demand = city / "demand.rou.xml"
    demand.write_text(DEMAND.replace('to="ce"', 'to="moon"', 1))
    refused(
        city, InputError, r"demand.rou.xml, line 2: <flow> cars names the edge moon"
    )
    demand.write_text('<routes><vType id="t" length="long"/></routes>')
    refused(city, InputError, "<vType> t needs a finite number for length, not 'long'")
    demand.write_text("<routes/>")
    refused(city, SynthesisError, "has no demand; expected route files")
    demand.write_text("<routes")
    refused(city, InputError, "no valid XML")
    demand.unlink()
    refused(city, InputError, "run.sumocfg: names demand.rou.xml, which is missing")
    (city / "run.sumocfg").write_text("<configuration/>")
    refused(city, InputError, "run.sumocfg: names no net-file")
    write_config(city, "run", "", "types.add.xml")
    refused(city, InputError, "types.add.xml: its root is <additional>; expected <net>")
    (city / "run.sumocfg").unlink()
    refused(city, InputError, r"has no \*.sumocfg")
    refused(city / "nowhere", InputError, "is no folder that can be read")
