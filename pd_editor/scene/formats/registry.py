"""All formats of scenes: those here, and those that other packages bring."""

import logging
import os
import re
from collections.abc import Callable, Collection, Iterable
from dataclasses import replace
from functools import cache, partial
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Final, TypeVar

from pd_editor.base.errors import ExportError, FormatError, InputError, LargeSceneError
from pd_editor.base.foreign_code import (
    asked,
    is_reference,
    object_of_reference,
    origin_of,
)
from pd_editor.base.plain_text import one_line
from pd_editor.scene.formats.argoverse2 import ARGOVERSE2
from pd_editor.scene.formats.commonroad import COMMONROAD
from pd_editor.scene.formats.gpudrive import GPUDRIVE
from pd_editor.scene.formats.lanelet2 import LANELET2
from pd_editor.scene.formats.opendrive import OPENDRIVE
from pd_editor.scene.formats.packed_file import (
    PACKED,
    head_of,
    unpacked_file,
    unpacked_name,
)
from pd_editor.scene.formats.pictures import PICTURES
from pd_editor.scene.formats.player import PLAYER
from pd_editor.scene.formats.scenarionet import SCENARIONET
from pd_editor.scene.formats.scene_format import SceneFormat, WrittenScene
from pd_editor.scene.formats.sumo import SUMO
from pd_editor.scene.formats.tables import TABLES
from pd_editor.scene.scenario import Scenario

Value = TypeVar("Value")

_LOG: Final = logging.getLogger(__name__)


def foreign_format(
    load: Callable[[], Any], place: str, taken: Collection[str]
) -> SceneFormat:
    """The format that is loaded from a place; of its faults, users see one sentence.

    Raises:
        InputError: it cannot be loaded, or is no format of a name that is not taken.
    """
    found = asked(
        lambda: _checked(load(), taken), place, " cannot be loaded", InputError
    )
    knows = found.recognises
    reads: Any = found.read
    writes: Any = found.write
    packed = tuple(f"{ending}{PACKED}" for ending in found.endings)

    def recognises(path: Path) -> bool:
        told = " did not say whether it knows a file"

        def known() -> bool:
            if knows(path):
                return True
            if not path.name.lower().endswith(packed):
                return False
            # Most are known without links to a whole folder.
            for is_alone in (True, False):
                with unpacked_file(path, is_alone=is_alone) as plain:
                    if knows(plain):
                        return True
            return False

        try:
            return asked(known, place, told, InputError)
        except InputError as error:
            _told_once(str(error))
            return False

    def read(path: Path) -> Scenario:
        told = f": {found.title} cannot be read"

        def found_in() -> Scenario:
            # Who knows gzipped files reads them; all others get them unpacked.
            if knows(path):
                return _a(Scenario, reads(path))
            with unpacked_file(path) as plain:
                return _a(Scenario, _named(reads, plain, path))

        return asked(found_in, str(path), told, FormatError)

    def write(scenario: Scenario) -> WrittenScene:
        told, name = f" cannot be written as {found.title}", scenario.scenario_id
        return asked(lambda: _plain_files(writes(scenario)), name, told, ExportError)

    return replace(
        found, recognises=recognises, read=reads and read, write=writes and write
    )


def _named(read: Callable[[Path], Any], plain: Path, path: Path) -> Any:
    """What is read of an unpacked file, with the name of the packed one in what is told."""

    def renamed(error: InputError) -> str:
        told = str(error).replace(str(plain), str(path))
        return told.replace(str(plain.parent), str(path.parent))

    try:
        found = read(plain)
    except LargeSceneError as error:
        scene = replace(error.scene, path=path)
        raise type(error)(renamed(error), scene, error.data) from error
    except InputError as error:
        raise FormatError(renamed(error)) from error
    if not isinstance(found, Scenario):
        return found
    return found.with_origin(source=os.path.realpath(path))


@cache
def _told_once(what: str) -> None:
    """Tell it the first time, since all files of a folder may be asked for."""
    _LOG.warning("%s", what)


def _a(kind: type[Value], found: Any, what: str = "") -> Value:
    if not isinstance(found, kind):
        got = f"{what}got a {type(found).__name__}"
        raise TypeError(f"{got}; expected a {kind.__name__}")
    return found


def _checked(found: Any, taken: Collection[str]) -> SceneFormat:
    if _a(SceneFormat, found).name in taken:
        raise ValueError(f"there is a format {found.name!r} already")
    for text in (found.name, found.title, *_a(tuple, found.endings)):
        _a(str, text)
    return found


def _plain_files(found: Any) -> WrittenScene:
    for name, data in _a(WrittenScene, found).files.items():
        _a(str, name)
        _a(bytes, data, f"file {name!r}: ")
    losses = (found.losses,) if isinstance(found.losses, str) else found.losses
    return replace(found, losses=tuple(one_line(str(one)) for one in losses))


ENTRY_POINTS: Final = "pd_editor.formats"
REFERENCES: Final = "PD_EDITOR_FORMATS"
"""Environment variable with added formats, so that processes started from here have them."""
OWN_FORMATS: Final[tuple[SceneFormat, ...]] = (
    ARGOVERSE2,
    COMMONROAD,
    GPUDRIVE,
    LANELET2,
    OPENDRIVE,
    SCENARIONET,
    SUMO,
    TABLES,
    PLAYER,
    *PICTURES,
)

_BESIDE: Final = (
    "without roads; put it beside its network under the same name, as town.{0}.xml beside "
    "town.net.xml, and open that."
)
_ROUTES: Final = (
    f"SUMO's routes, {_BESIDE.format('rou')} Sizes are read from it, and motion from "
    "town.fcd.xml, which sumo --fcd-output writes; or open a .sumocfg that names them all."
)
_ALONE: Final = {
    "<fcd-export": f"SUMO's floating-car data, {_BESIDE.format('fcd')}",
    "<routes": _ROUTES,
    "<trips": _ROUTES,
    **dict.fromkeys(
        ("<nodes", "<edges"),
        "plain XML of SUMO; netconvert -n A.nod.xml -e A.edg.xml -o A.net.xml makes a network.",
    ),
    "<additional": f"a SUMO additional file, {_BESIDE.format('add')}",
    "<commonroadsolution": "a CommonRoad solution, without roads; open its scenario.",
    "<openscenario": "OpenSCENARIO without a road network; expected a <LogicFile> in its "
    "<RoadNetwork> that names an .xodr file, which lies beside it.",
    ".sumocfg": "a SUMO configuration without its network; expected its <net-file> with it.",
    "dataset_summary.pkl": "the summary of a ScenarioNet data set; open its scenes.",
    "dataset_mapping.pkl": "the mapping of a ScenarioNet data set; open its scenes.",
    ".pbf": "an OpenStreetMap extract, without lanes; osmium cat IN.pbf -o IN.osm and "
    "netconvert --osm-files IN.osm -o OUT.net.xml make a network of it.",
    ".pb": "a protocol buffer, such as CommonRoad's; commonroad-io writes XML of it.",
    ".csv": "a table without roads; a format of your own can read it (examples/csv_format.py).",
    ".tfrecord": "a Waymo record; ScenarioNet makes .pkl files of it, GPUDrive .json.",
}
"""What files are that no format reads alone, by their XML root or ending."""


@cache
def formats() -> dict[str, SceneFormat]:
    """Formats by name, of which those here come first; broken ones of others are left out."""
    found = {one.name: one for one in OWN_FORMATS}
    for point in entry_points(group=ENTRY_POINTS):
        try:
            place = f"The format {point.name!r} ({origin_of(point)})"
            value = foreign_format(point.load, place, found)
            found[value.name] = value
        except InputError as error:
            _LOG.warning("%s", error)
    for reference in os.environ.get(REFERENCES, "").split():
        value = _of_reference(reference, found)
        found[value.name] = value
    return found


def add_formats(*references: str) -> None:
    """Add formats of your own, each named as ``package.module:attribute``.

    Processes that are started from here on know them as well.

    Raises:
        InputError: one cannot be imported, is no format, or has the name of another.
    """
    for reference in references:
        known, added = formats(), os.environ.get(REFERENCES, "").split()
        if reference not in added:
            _of_reference(reference, known)
            os.environ[REFERENCES] = " ".join([*added, reference])
            formats.cache_clear()


def _of_reference(reference: str, taken: Collection[str]) -> SceneFormat:
    if not is_reference(reference):
        raise InputError(
            f"{one_line(reference, 60)!r} names no format; expected "
            "package.module:attribute."
        )
    load = partial(object_of_reference, reference, InputError)
    return foreign_format(load, reference, taken)


def format_of(path: Path) -> SceneFormat | None:
    """The format that a path holds and that can be read; None if no one knows it."""
    for one in formats().values():
        if one.read is not None and one.recognises(path):
            return one
    return None


def writer(name: str) -> SceneFormat:
    """The format of a name, which can be written.

    Raises:
        ExportError: there is none.
    """
    found = formats().get(name)
    if found is None or found.write is None:
        known = ", ".join(one.name for one in formats().values() if one.write)
        raise ExportError(f"No format {name[:40]!r} can be written; there are {known}.")
    return found


def has_foreign_ending(name: str) -> bool:
    """Whether a file of this name may be of a format other than Argoverse 2."""
    endings = tuple(one for kind in formats().values() for one in kind.endings)
    return unpacked_name(name.lower()).endswith(endings)


def name_of_scene(path: Path) -> str:
    """Name of a foreign file or folder, of a file without the ending of its format."""
    name = path.absolute().name
    if path.is_dir():
        return name
    name = unpacked_name(name)
    every = [one for kind in formats().values() for one in kind.endings]
    known = [one for one in every if name.lower().endswith(one)]
    return name[: -max(map(len, known))] if known else name


def is_foreign_scene(path: Path) -> bool:
    """Whether a file or folder is a scene of a format other than Argoverse 2."""
    return bool(foreign_scenes_among([path]))


def foreign_scenes_among(paths: Iterable[Path]) -> list[Path]:
    """Scenes of formats other than Argoverse 2, sorted.

    Files of one format in one folder and of one name, such as a road network and the
    traffic on it, are one scene, of which the first file is given.
    """
    found: dict[tuple[Path, str, str], Path] = {}
    others = [one for one in formats().values() if one.read and one is not ARGOVERSE2]
    for path in sorted(paths):
        is_file = has_foreign_ending(path.name) and os.path.isfile(path)
        if is_file or os.path.isdir(path):
            for kind in (one for one in others if one.recognises(path)):
                key = path.parent, name_of_scene(path), kind.name
                found.setdefault(key, path)
                break
    return list(found.values())


def read_scene(path: Path) -> Scenario:
    """Read a scenario's folder, or a file of another format.

    Raises:
        InputError: it cannot be read.
    """
    kind = format_of(path) or ARGOVERSE2
    assert kind.read is not None, "it can be read"
    title = "" if kind is ARGOVERSE2 else kind.title
    try:
        scenario = kind.read(path)
    except LargeSceneError as error:
        error.scene = replace(error.scene, file_format=title)
        raise
    return scenario.with_origin(file_format=title)


def unread_file(path: Path) -> str | None:
    """What a file is that no format reads alone, and how it is opened; None for others."""
    name, head = unpacked_name(path.name.lower()), head_of(path)
    for sign, told in _ALONE.items():
        is_root = sign[0] == "<" and re.search(rf"{sign}[\s/>]".encode(), head)
        if is_root or name.endswith(sign):
            return f"is {told}"
    return None
