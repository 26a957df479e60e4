"""Reads SUMO scenarios that others made: networks with their demand."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from pd_editor.base.errors import InputError, SynthesisError
from pd_editor.scene.formats.packed_file import read_unpacked
from pd_editor.scene.formats.sumo_net import SumoNet, read_sumo_net
from pd_editor.scene.formats.xml_file import Place, parse_xml

CONFIG_ENDINGS: Final = (".sumocfg", ".sumo.cfg")
_TRAVELLERS: Final = ("vehicle", "trip", "person")
_FLOWS: Final = ("flow", "personFlow")
_ROUTES: Final = ("route", "routeDistribution")
_TYPES: Final = ("vType", "vTypeDistribution")
_PLACES: Final = (
    "busStop", "trainStop", "parkingArea", "tlLogic", "WAUT", "wautJunction", "rerouter",
)  # fmt: skip
"""Contents of additional files that are used; detectors and outputs are left out."""
_NOT_ON_ROADS: Final = (
    "tram", "rail", "rail_urban", "rail_electric", "rail_fast", "subway", "cable_car",
    "ship", "aircraft", "drone",
)  # fmt: skip
_FLOW_STEP_S: Final = 60.0


@dataclass(frozen=True, kw_only=True, eq=False)
class SumoScenario:
    """A network and its demand; elements are those of the files, in their order."""

    name: str
    """Name of its folder."""
    net_file: Path
    net: SumoNet
    types: tuple[etree._Element, ...]
    """Types of vehicles and persons, and distributions of them."""
    files: tuple[tuple[etree._Element, ...], ...]
    """Elements of each additional file and each route file, types left out."""
    departures_s: Float[np.ndarray, "D"]
    """Sorted times of departures; of flows, a time each minute."""
    options: tuple[str, ...]
    """Options of its configuration that concern routing and the amount of traffic."""

    def write(self, folder: Path, net_name: str) -> list[str]:
        """Write the network, unpacked, and the other files; returns their names."""
        (folder / net_name).write_bytes(read_unpacked(self.net_file)[0])
        names = []
        for number, elements in enumerate(self.files):
            root = etree.Element("additional")
            root.extend(elements)
            names.append(f"scenario{number}.add.xml")
            (folder / names[-1]).write_bytes(etree.tostring(root))
        return names


def read_sumo_scenario(folder: Path) -> SumoScenario:
    """Read the scenario of a folder; of several configurations the one of most files.

    Raises:
        InputError: a file is missing or damaged, or names an edge that does not exist.
        SynthesisError: nobody departs.
    """
    config, root = _config(folder)
    net_file = _files(config, root, "net-file", "net", "n")[0]
    net = read_sumo_net(net_file)
    types: list[etree._Element] = []
    files: list[tuple[etree._Element, ...]] = []
    departures: list[float] = []
    for path in _demand_files(config, root):
        found, used = parse_xml(path, None)[0], []
        for one in found.iterchildren(etree.Element):
            if one.tag in _TYPES:
                types.append(one)
            elif one.tag in (*_TRAVELLERS, *_FLOWS, *_ROUTES):
                _check_edges(Place(path, one), net, net_file)
                departures += _departures(one)
                used.append(one)
            elif one.tag in _PLACES:
                used.append(one)
        files.append(tuple(used))
    if not departures:
        raise SynthesisError(
            f"{config}: has no demand; expected route files in which somebody departs."
        )
    rails = {
        one.get("id")
        for part in types
        for one in part.iter("vType")
        if one.get("vClass") in _NOT_ON_ROADS
    }
    return SumoScenario(
        name=folder.resolve().name,
        net_file=net_file,
        net=net,
        types=tuple(types),
        files=tuple(
            tuple(one for one in part if one.get("type") not in rails) for part in files
        ),
        departures_s=np.sort(departures),
        options=tuple(
            text
            for one in root.iter(etree.Element)
            if one.tag == "scale"
            or (one.tag.startswith("device.rerouting.") and "output" not in one.tag)
            for text in (f"--{one.tag}", one.get("value") or "")
        ),
    )


def _config(folder: Path) -> tuple[Path, etree._Element]:
    """The configuration without missing files that names most files of demand."""
    if not folder.is_dir():
        raise InputError(f"{folder}: is no folder; expected one with a SUMO scenario.")
    paths = sorted(p for p in folder.iterdir() if p.name.endswith(CONFIG_ENDINGS))
    best: tuple[int, Path, etree._Element] | None = None
    failure = InputError(
        f"{folder}: has no *.sumocfg; expected one that names a network and demand."
    )
    for path in paths:
        try:
            root = parse_xml(path, None)[0]
            if not _files(path, root, "net-file", "net", "n"):
                raise InputError(f"{path}: names no net-file; expected a SUMO network.")
            count = len(_demand_files(path, root))
        except InputError as error:
            failure = error
            continue
        if best is None or count > best[0]:
            best = count, path, root
    if best is None:
        raise failure
    return best[1:]


def _demand_files(config: Path, root: etree._Element) -> list[Path]:
    """Additional files, which routes may refer to, then route files."""
    return [
        *_files(config, root, "additional-files", "additional", "a"),
        *_files(config, root, "route-files", "routes", "r"),
    ]


def _files(config: Path, root: etree._Element, *options: str) -> list[Path]:
    named = ",".join(one.get("value") or "" for one in root.iter(*options))
    paths = [config.parent / name.strip() for name in named.split(",") if name.strip()]
    for path in paths:
        if not path.is_file():
            raise InputError(f"{config}: names the file {path.name}, which is missing.")
    return paths


def _check_edges(place: Place, net: SumoNet, net_file: Path) -> None:
    for one in place.element.iter(etree.Element):
        for key in ("edges", "from", "to", "via"):
            for edge in (one.get(key) or "").split():
                if edge not in net.junction_of and not edge.startswith(":"):
                    raise place.error(
                        f"names the edge {edge[:40]}, which {net_file.name} lacks."
                    )


def _departures(one: etree._Element) -> Iterator[float]:
    if one.tag in _TRAVELLERS:
        yield from _seconds(one.get("depart"))
    elif one.tag in _FLOWS:
        begin, end = (list(_seconds(one.get(key))) for key in ("begin", "end"))
        if begin:
            last = max(end[0] if end else begin[0], begin[0])
            yield from np.arange(begin[0], last + _FLOW_STEP_S, _FLOW_STEP_S).tolist()


def _seconds(text: str | None) -> Iterator[float]:
    """A time such as 3600.0, 01:00:00 or 0:01:00:00; none if it is no number."""
    try:
        parts = [float(part) for part in (text or "").split(":")]
    except ValueError:
        return
    value = sum(
        part * unit
        for part, unit in zip(parts[::-1], (1, 60, 3600, 86400), strict=False)
    )
    if np.isfinite(value):
        yield value
