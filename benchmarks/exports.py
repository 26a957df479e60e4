"""Scenes in every format, there and back, by our readers and by the formats' own loaders.

Scenes of PD_EDITOR_AV2's ``train`` and ``val``, each plain, on two warped roads, with all
road users resampled and with as many as fit. A scene is accepted if the format's own loader
takes it and if all that is compared agrees: states within 1 mm, 0.1 degree and 0.05 m/s,
links of lanes, centre lines within 5 cm (CommonRoad's are midway between bounds: 0.4 m).
``--loaders`` asks the loaders of ``tests/oracles`` and SUMO's tools too, which takes long.
"""

import argparse
import os
import shutil
import time
import traceback
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

import pd_editor
from pd_editor.base.errors import PdEditorError
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.av2_io.official import check_with_official_loaders
from pd_editor.scene.formats.registry import formats
from pd_editor.scene.scenario import Scenario
from tests.oracles.environment import oracle
from tests.scene.av2_io.round_trip import compare, copy_scenario
from tests.scene.formats import (
    test_commonroad_writer,
    test_opendrive_writer,
    test_oracles,
    test_recording_writers,
    test_sumo_writer,
)

WARPS = ("double-turn", "smooth-turn")


def edited(folder: Path, out: Path) -> Iterator[Path]:
    """The scene and its variants, which are made once."""
    yield folder
    for kind in WARPS:
        target = out / kind / folder.name
        if not target.exists():
            pd_editor.warp(
                folder, kind=kind, power=6.0, name=folder.name, out=target.parent
            )
        yield target
    agents, step = open_scenario(folder).agents, 49
    rows = agents.is_valid[:, step] & agents.kind_mask(ROAD_USER_KINDS)
    ids = tuple(agents.ids[row] for row in np.flatnonzero(rows))
    asked = {
        "resampled": {"agents": ids, "resample_states": True},
        "fit": {"num_agents": "fit", "replace_ego_and_focal": True},
    }
    for name, options in asked.items():
        target = out / name / folder.name
        if not target.exists():
            pd_editor.generate(folder, name=folder.name, out=target.parent, **options)
        yield target


def check_av2(scenario: Scenario, folder: Path, *, asks: bool) -> None:
    """Argoverse 2: equal rows, and the official loaders."""
    source = Path(scenario.provenance.source)
    same = compare(source, copy_scenario(source, folder))
    assert not same.differing_columns, same.differing_columns
    assert not same.differing_map_fields, same.differing_map_fields
    if asks:
        check_with_official_loaders(folder / scenario.scenario_id)


def check_opendrive(scenario: Scenario, folder: Path, *, asks: bool) -> None:
    """OpenDRIVE and OpenSCENARIO: our reader, ASAM's checkers, netconvert."""
    path = test_opendrive_writer.written(scenario, folder)
    test_opendrive_writer.check_roads(scenario, path)
    test_opendrive_writer.check_agents(scenario, path)
    if asks:
        paths = [str(path), str(path.with_suffix(".xosc"))]
        for answer in oracle("asam").ask("asam_issues.py", paths):
            assert not answer["issues"], answer["issues"][0]
        test_opendrive_writer.check_netconvert(scenario, path)


def check_commonroad(scenario: Scenario, folder: Path, *, asks: bool) -> None:
    """CommonRoad: our reader, commonroad-io."""
    test_commonroad_writer.check_same(scenario, folder)
    if asks:
        test_oracles.check_commonroad([scenario], folder, oracle("commonroad"))


def check_scenarionet(scenario: Scenario, folder: Path, *, asks: bool) -> None:
    """ScenarioNet: our reader, MetaDrive."""
    test_recording_writers.check_same(scenario, "scenarionet", folder)
    if asks:
        test_oracles.check_metadrive([scenario], folder, oracle("metadrive"))


def check_gpudrive(scenario: Scenario, folder: Path, *, asks: bool) -> None:
    """GPUDrive: our reader; its own runs on a GPU."""
    del asks
    test_recording_writers.check_same(scenario, "gpudrive", folder)


def check_sumo(scenario: Scenario, folder: Path, *, asks: bool) -> None:
    """SUMO: our reader, sumolib, sumo; these are always asked."""
    del asks
    test_sumo_writer.check(scenario, folder)


CHECKS: dict[str, Callable[..., None]] = {
    "av2": check_av2,
    "opendrive": check_opendrive,
    "commonroad": check_commonroad,
    "scenarionet": check_scenarionet,
    "gpudrive": check_gpudrive,
    "sumo": check_sumo,
}


def main() -> None:
    """Print why scenes are not accepted, then how many are, and times of writing."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--formats", nargs="*", default=list(CHECKS))
    parser.add_argument("--every", type=int, default=1, help="take every nth scene")
    parser.add_argument("--loaders", action="store_true")
    options = parser.parse_args()
    root = Path(os.environ["PD_EDITOR_AV2"])
    sources = [one for split in ("train", "val") for one in (root / split).iterdir()]
    refused: defaultdict[str, list[str]] = defaultdict(list)
    took: defaultdict[str, list[float]] = defaultdict(list)
    for source in sorted(sources)[:: options.every]:
        for number, folder in enumerate(edited(source, options.out)):
            scenario = open_scenario(folder)
            for name in options.formats:
                write = formats()[name].write
                assert write is not None
                began = time.perf_counter()
                write(scenario)
                took[name].append(time.perf_counter() - began)
                target = options.out / "written" / name / f"{source.name}-{number}"
                shutil.rmtree(target, ignore_errors=True)
                target.mkdir(parents=True)
                try:
                    CHECKS[name](scenario, target, asks=options.loaders)
                except (AssertionError, PdEditorError) as error:
                    place = traceback.extract_tb(error.__traceback__)[-1]
                    why = str(error).strip() or place.line
                    refused[name].append(f"{folder}: {place.name}: {why}"[:400])
                    print(f"{name}: {refused[name][-1]}", flush=True)
    for name in options.formats:
        times, bad = took[name], refused[name]
        quartiles = np.quantile(times, [0.25, 0.5, 0.75, 1.0])
        print(
            f"{name:12}{len(times) - len(bad)} of {len(times)} accepted; written in "
            f"{1e3 * quartiles[1]:.0f} ms (quartiles {1e3 * quartiles[0]:.0f} to "
            f"{1e3 * quartiles[2]:.0f}, most {1e3 * quartiles[3]:.0f})"
        )


if __name__ == "__main__":
    main()
