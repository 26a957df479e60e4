"""A small SUMO scenario: a crossing with signals, footways, and demand of all kinds."""

from pathlib import Path

from pd_editor.experiments.synthesis.sumo.sumo_tools import run_sumo_tool

NODES = {"c": (0, 0), "w": (-150, 0), "e": (150, 0), "s": (0, -150), "n": (0, 150)}
TYPES = """<additional>
  <vType id="truck" vClass="truck"/><vType id="taxi" vClass="taxi"/>
  <vTypeDistribution id="private">
    <vType id="short" vClass="passenger" length="4.5" probability="0.5"/>
    <vType id="licence" vClass="bus" length="5" probability="0.5"/>
  </vTypeDistribution>
  <vTypeDistribution id="mixed" vTypes="truck taxi"/>
  <vType id="coach" vClass="bus"/><vType id="bike" vClass="bicycle"/>
  <vType id="rails" vClass="tram"/>
  <busStop id="stop" lane="ce_1" startPos="40" endPos="60"/>
  <e1Detector id="d" lane="wc_1" pos="9" freq="60" file="/nowhere/detector.xml"/>
</additional>"""
DEMAND = """<routes>
  <flow id="cars" type="private" begin="0" end="00:20:00" period="6" from="wc" to="ce"/>
  <flow id="usual" begin="0" end="1200" period="8" from="sc" to="cn"/>
  <flow id="trucks" type="truck" begin="0" end="1200" period="40" from="nc" to="cs"/>
  <flow id="mixed" type="mixed" begin="0" end="1200" period="20" from="wc" to="ce"/>
  <flow id="inner" type="short" begin="0" end="1200" period="40" from="sc" to="cn"/>
  <flow id="bikes" type="bike" begin="0" end="1200" period="15" from="ec" to="cw"/>
  <flow id="tram" type="rails" begin="0" end="1200" period="30" from="wc" to="ce"/>
  <flow id="bus" type="coach" line="1" begin="0" end="1200" period="60" from="wc" to="ce">
    <stop busStop="stop" duration="10"/>
  </flow>
  <personFlow id="walks" begin="0" end="1200" period="5"><walk from="wc" to="cn"/></personFlow>
  <personFlow id="rides" begin="0" end="1200" period="60">
    <walk from="wc" busStop="stop"/><ride busStop="stop" lines="1"/><walk to="ce"/>
  </personFlow>
</routes>"""
CONFIG = """<configuration><input><net-file value="{}"/><route-files value="{}"/>
  <additional-files value="types.add.xml"/></input><output><tripinfo-output
  value="/nowhere/trips.xml"/></output></configuration>"""


def small_city(
    folder: Path, demand: str = DEMAND, *, signals: bool = True, footways: bool = True
) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    kind = {"c": "traffic_light" if signals else "priority"}
    nodes = "".join(
        f'<node id="{name}" x="{x}" y="{y}" type="{kind.get(name, "priority")}"/>'
        for name, (x, y) in NODES.items()
    )
    edges = "".join(
        f'<edge id="{one}" from="{one[0]}" to="{one[1]}" numLanes="1" speed="13"/>'
        for name in "wesn"
        for one in (f"{name}c", f"c{name}")
    )
    (folder / "plain.nod.xml").write_text(f"<nodes>{nodes}</nodes>")
    (folder / "plain.edg.xml").write_text(f"<edges>{edges}</edges>")
    options = ["-n", "plain.nod.xml", "-e", "plain.edg.xml", "-o", "roads.net.xml"]
    if footways:
        options += ["--sidewalks.guess", "--crossings.guess"]
    run_sumo_tool("netconvert", options, folder)
    text = TYPES if footways else TYPES.replace("_1", "_0")
    (folder / "types.add.xml").write_text(text)
    (folder / "demand.rou.xml").write_text(demand)
    write_config(folder, "run", "demand.rou.xml")
    return folder


def write_config(
    folder: Path, name: str, routes: str, net: str = "roads.net.xml"
) -> None:
    (folder / f"{name}.sumocfg").write_text(CONFIG.format(net, routes))
