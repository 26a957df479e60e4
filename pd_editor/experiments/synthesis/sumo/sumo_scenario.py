"""Reads SUMO scenarios that others made: networks with their demand."""

import os
import re
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from pd_editor.base.errors import InputError, SynthesisError
from pd_editor.scene.formats.sumo_net import SumoNet, read_sumo_net
from pd_editor.scene.formats.xml_file import Place, added, parse_xml

_FILES: Final = ("net-file", "additional-files", "route-files")
_DEMAND: Final = (
    "vehicle", "trip", "person", "flow", "personFlow", "route", "routeDistribution",
)  # fmt: skip
_OTHERS: Final = (
    "vType", "vTypeDistribution", "busStop", "trainStop", "parkingArea", "tlLogic", "WAUT",
    "wautJunction", "rerouter",
)  # fmt: skip
"""What is used beside the demand: neither detectors nor outputs."""
_USUAL_TYPES: Final = {
    "DEFAULT_VEHTYPE": "passenger", "DEFAULT_TAXITYPE": "taxi",
    "DEFAULT_BIKETYPE": "bicycle", "DEFAULT_PEDTYPE": "pedestrian",
}  # fmt: skip
"""Classes of SUMO's own types."""
_NOT_ON_ROADS: Final = (
    "tram", "rail", "rail_urban", "rail_electric", "rail_fast", "subway", "cable_car",
    "ship", "aircraft", "drone",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class SumoScenario:
    """A network and its demand."""

    name: str
    """See ``city_name``."""
    net_file: Path
    net: SumoNet
    files: tuple[etree._Element, ...]
    """What is used of additional files and route files, after SUMO's own types."""
    span_s: tuple[float, float]
    """First and last departure."""

    @property
    def notes(self) -> tuple[str, ...]:
        """A sentence for each of signals and footways that the network lacks."""
        walks = any(lane.is_sidewalk for lane in self.net.lanes.values())
        lacks = {"signals": self.net.has_signals, "footways": walks}
        return tuple(f"{self.name} has no {k}." for k, has in lacks.items() if not has)


def city_name(folder: Path) -> str:
    """Name of a scenario's folder, with characters that may stand in names of files."""
    return re.sub(r"[^A-Za-z0-9_-]+", "-", os.path.basename(os.path.realpath(folder)))


def read_sumo_scenario(folder: Path) -> SumoScenario:
    """Read the scenario of a folder; of several configurations the one of most files.

    Raises:
        InputError: a file is missing or damaged, or names an edge that does not exist.
        SynthesisError: nobody departs.
    """
    net_file, *paths = _named_files(folder)
    net = read_sumo_net(net_file)
    roots = [parse_xml(path, None)[0].element for path in paths]
    types = {one.get("id"): one for root in roots for one in root.iter("vType")}
    usual = etree.Element("additional")
    for name, vehicle_class in _USUAL_TYPES.items():
        if name not in types:
            added(usual, "vType", id=name, vClass=vehicle_class)
    rails = {k for k, one in types.items() if one.get("vClass") in _NOT_ON_ROADS}
    rails.add("DEFAULT_RAILTYPE")
    times: list[float] = []
    for path, root in zip(paths, roots, strict=True):
        for one in root.xpath("//vType[@length]"):
            Place(path, one).number("length")
        for one in root.xpath("//param[contains(@key, 'file')]"):
            # SUMO would write the file.
            one.getparent().remove(one)
        for one in list(root):
            if one.tag not in (*_DEMAND, *_OTHERS) or one.get("type") in rails:
                root.remove(one)
            elif one.tag in _DEMAND:
                _check_edges(Place(path, one), net, net_file)
                times += map(_seconds, map(one.get, ("depart", "begin", "end")))
            if one.tag == "personFlow":
                # SUMO's saved states lack flows of persons.
                root.remove(one)
                root.extend(_persons(Place(path, one)))
    times = [one for one in times if np.isfinite(one)]
    if not times:
        raise SynthesisError(
            f"{folder}: has no demand; expected route files in which somebody departs."
        )
    return SumoScenario(
        name=city_name(folder),
        net_file=net_file,
        net=net,
        files=(usual, *roots),
        span_s=(min(times), max(times)),
    )


def _named_files(folder: Path) -> list[Path]:
    """Network and files of demand of the configuration that has most, none missing."""
    found: list[Path] = []
    failure: InputError | None = None
    try:
        configs = [
            one
            for one in sorted(os.listdir(folder))
            if one.endswith((".sumocfg", ".sumo.cfg"))
        ]
    except OSError as error:
        raise InputError(
            f"{folder}: is no folder that can be read ({error})."
        ) from error
    for config in (folder / name for name in configs):
        root = parse_xml(config, None)[0].element
        names = [
            name.strip()
            for tag in _FILES
            for one in root.iter(tag)
            for name in (one.get("value") or "").split(",")
            if name.strip()
        ]
        missing = [name for name in names if not os.path.isfile(folder / name)]
        if missing or root.find(f".//{_FILES[0]}") is None:
            what = f"{missing[0]}, which is missing" if missing else "no net-file"
            failure = InputError(f"{config}: names {what}; expected a SUMO network.")
        elif len(names) > len(found):
            found = [folder / name for name in names]
    if not found:
        raise failure or InputError(
            f"{folder}: has no *.sumocfg; expected one that names a network and demand."
        )
    return found


def _check_edges(place: Place, net: SumoNet, net_file: Path) -> None:
    for one in place.element.iter(etree.Element):
        for key in ("edges", "from", "to", "via"):
            for edge in (one.get(key) or "").split():
                if edge not in net.junction_of and not edge.startswith(":"):
                    raise place.error(
                        f"names the edge {edge[:40]}, which {net_file.name} lacks."
                    )


def _persons(flow: Place) -> Iterator[etree._Element]:
    """Persons of a flow, at equal intervals; none of a flow that does not end."""
    told = flow.element.attrib
    begin, end = _seconds(told.get("begin", "0")), _seconds(told.get("end"))
    if not np.isfinite(end - begin):
        return
    random = re.fullmatch(r"exp\((\d*\.?\d+)\)", told.get("period", ""))
    if random is None and "period" in told:
        step = flow.number("period")
    else:
        of_rate = {"perHour": 3600.0, "probability": 1.0, "number": end - begin}
        key = next((one for one in of_rate if one in told), "period")
        rate = float(random[1]) if random else flow.number(key) / of_rate[key]
        step = 1.0 / max(rate, 1e-6)
    kept = {key: told[key] for key in ("type", "departPos") if key in told}
    for row, depart in enumerate(np.arange(begin, end, max(step, 0.1)).tolist()):
        person = etree.Element(
            "person", kept, id=f"{told['id']}.{row}", depart=f"{depart}"
        )
        person.extend(map(deepcopy, flow.element))
        yield person


def _seconds(text: str | None) -> float:
    """A time such as 3600.0, 01:00:00 or 0:01:00:00; NaN if it is none."""
    parts = re.fullmatch(r"(?:(?:(\d+):)?(\d+):(\d+):)?(\d+(?:\.\d*)?)", text or "")
    if parts is None:
        return np.nan
    days, hours, minutes, seconds = (float(part or 0) for part in parts.groups())
    return ((days * 24 + hours) * 60 + minutes) * 60 + seconds
