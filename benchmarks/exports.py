"""Scenes in every format, there and back, by our readers and by the formats' own loaders.

Scenes of PD_EDITOR_AV2's ``train`` and ``val``, each plain, on two warped roads, with all
road users resampled and with as many as fit. A scene is accepted if the format's own loader
takes it and if all that is compared agrees: states within 1 mm, 0.1 degree and 0.05 m/s,
links of lanes, centre lines within 5 cm.
``--loaders`` asks the loaders of ``tests/oracles`` too, which takes long. Answers are kept
in ``answers.jsonl``: a run that goes on asks again about what was refused, and what is new.
"""

import argparse
import json
import os
import shutil
import time
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

import pd_editor
from pd_editor.base.errors import PdEditorError
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.agent_kind import ROAD_USER_KINDS
from pd_editor.scene.av2_io.write import check_with_official_loaders
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
from tests.scene.formats.agreement import Worst

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


def check_av2(scenario: Scenario, folder: Path) -> Worst:
    """Argoverse 2: equal rows."""
    source = Path(scenario.provenance.source)
    same, worst = compare(source, copy_scenario(source, folder)), Worst()
    assert not same.differing_columns, same.differing_columns
    assert not same.differing_map_fields, same.differing_map_fields
    worst.note("position_m", same.position_error_m)
    worst.note("center_m", same.map_error_m)
    return worst


def check_opendrive(scenario: Scenario, folder: Path) -> Worst:
    """OpenDRIVE and OpenSCENARIO: our reader."""
    path = test_opendrive_writer.written(scenario, folder)
    worst = test_opendrive_writer.check_roads(scenario, path)
    return Worst(worst | test_opendrive_writer.check_agents(scenario, path))


def check_recording(name: str, scenario: Scenario, folder: Path) -> Worst:
    """ScenarioNet and GPUDrive: our reader."""
    return test_recording_writers.check_same(scenario, name, folder)


CHECKS: dict[str, Callable[[Scenario, Path], Worst]] = {
    "av2": check_av2,
    "opendrive": check_opendrive,
    "commonroad": test_commonroad_writer.check_same,
    "scenarionet": partial(check_recording, "scenarionet"),
    "gpudrive": partial(check_recording, "gpudrive"),
    # With sumolib and sumo.
    "sumo": test_sumo_writer.check,
}


def ask_av2(told: list[Scenario], folders: list[Path]) -> None:
    """The package av2."""
    for scenario, folder in zip(told, folders, strict=True):
        check_with_official_loaders(folder / scenario.scenario_id)


def ask_opendrive(told: list[Scenario], folders: list[Path]) -> None:
    """ASAM's checkers, and netconvert."""
    roads = [
        folder / f"{scenario.scenario_id}.xodr"
        for scenario, folder in zip(told, folders, strict=True)
    ]
    paths = [str(one.with_suffix(end)) for one in roads for end in (".xodr", ".xosc")]
    for answer in oracle("asam").ask("asam_issues.py", paths):
        assert not answer["issues"], answer["issues"][0]
    for scenario, road in zip(told, roads, strict=True):
        test_opendrive_writer.check_netconvert(scenario, road)


def ask_commonroad(told: list[Scenario], folders: list[Path]) -> None:
    """The package commonroad-io."""
    test_oracles.check_commonroad(told, folders[0], oracle("commonroad"))


def ask_metadrive(told: list[Scenario], folders: list[Path]) -> None:
    """MetaDrive's replay."""
    test_oracles.check_metadrive(told, folders[0], oracle("metadrive"))


LOADERS: dict[str, Callable[[list[Scenario], list[Path]], None]] = {
    "av2": ask_av2,
    "opendrive": ask_opendrive,
    "commonroad": ask_commonroad,
    "scenarionet": ask_metadrive,
}


@dataclass(frozen=True)
class Answer:
    """Of one variant of a scene in one format; ``why`` it is refused, or empty."""

    variant: str
    format: str
    took_s: float
    why: str
    worst: dict[str, float]


def why_not(check: Callable[..., object], *about: object) -> str:
    """Why a check fails; empty if it does not."""
    try:
        check(*about)
    except (AssertionError, PdEditorError) as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        return f"{place.name}: {str(error).strip() or place.line}"[:400]
    return ""


def note_all(
    worst: Worst,
    check: Callable[[Scenario, Path], Worst],
    scenario: Scenario,
    folder: Path,
) -> None:
    """Keep the differences that a check finds."""
    worst.update(check(scenario, folder))


def answers(
    source: Path, out: Path, known: set[tuple[str, str]], *, asks: bool
) -> list[Answer]:
    """Of all variants of a scene in all formats, without those that are known."""
    found: dict[tuple[str, str], tuple[Scenario, Path, Answer]] = {}
    for number, folder in enumerate(edited(source, out)):
        variant = f"{source.name}-{number}"
        names = [name for name in CHECKS if (variant, name) not in known]
        for name in names:
            scenario, write = open_scenario(folder), formats()[name].write
            assert write is not None
            began = time.process_time()
            write(scenario)
            took_s = time.process_time() - began
            target = out / "written" / name / variant
            shutil.rmtree(target, ignore_errors=True)
            target.mkdir(parents=True)
            worst = Worst()
            why = why_not(note_all, worst, CHECKS[name], scenario, target)
            answer = Answer(variant, name, took_s, why, dict(worst))
            found[variant, name] = scenario, target, answer
    for name, ask in LOADERS.items() if asks else ():
        fine = {key: one for key, one in found.items() if key[1] == name}
        fine = {key: one for key, one in fine.items() if not one[2].why}
        told, folders = ([one[n] for one in fine.values()] for n in (0, 1))
        # All at once, since to start a loader takes longest.
        if told and why_not(ask, told, folders):
            for key, (scenario, target, answer) in fine.items():
                why = why_not(ask, [scenario], [target])
                found[key] = scenario, target, replace(answer, why=why)
    return [answer for *_, answer in found.values()]


def main() -> None:
    """Print why scenes are not accepted, then how many are, gaps and times of writing."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--every", type=int, default=1, help="take every nth scene")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--loaders", action="store_true")
    parser.add_argument("--formats", nargs="+", choices=CHECKS, default=list(CHECKS))
    options = parser.parse_args()
    for name in CHECKS.keys() - options.formats:
        del CHECKS[name]
        LOADERS.pop(name, None)
    root = Path(os.environ["PD_EDITOR_AV2"])
    sources = [one for split in ("train", "val") for one in (root / split).glob("*/")]
    options.out.mkdir(parents=True, exist_ok=True)
    kept = options.out / "answers.jsonl"
    lines = kept.read_text().splitlines() if kept.exists() else []
    every = [
        one for one in (Answer(**json.loads(line)) for line in lines) if not one.why
    ]
    known = {(one.variant, one.format) for one in every}
    with ProcessPoolExecutor(options.workers) as pool, kept.open("a") as file:
        jobs = [
            pool.submit(answers, source, options.out, known, asks=options.loaders)
            for source in sorted(sources)[:: options.every]
        ]
        for job in as_completed(jobs):
            for one in job.result():
                every.append(one)
                print(json.dumps(asdict(one)), file=file, flush=True)
                if one.why:
                    print(f"{one.format}: {one.variant}: {one.why}", flush=True)
    for name in CHECKS:
        own = [one for one in every if one.format == name]
        quartiles = 1e3 * np.quantile(
            [one.took_s for one in own], [0.25, 0.5, 0.75, 1.0]
        )
        low, median, high, most = quartiles.round().astype(int)
        worst = Worst()
        for key, gap in (pair for one in own for pair in one.worst.items()):
            worst.note(key, gap)
        print(
            f"{name:12}{sum(not one.why for one in own)} of {len(own)} accepted; "
            + ", ".join(f"{key} {gap:.2g}" for key, gap in sorted(worst.items()))
            + f"; written in {median} ms of processor time (quartiles {low} to {high}, "
            f"most {most})"
        )


if __name__ == "__main__":
    main()
