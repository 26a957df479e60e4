"""Systems of the paper's tables: references, and the variants found in folders."""

import json
import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pd_editor.base.errors import InputError
from pd_editor.base.regular_file import read_regular
from pd_editor.experiments.evaluation.method import GROUND_TRUTH
from pd_editor.generation.defaults import MAX_CONFIG_BYTES
from pd_editor.generation.generators import saw_warps, warp_share

CONFIG_NAME: Final = "config.json"
RUNS_NAME: Final = "runs"
STATES, TRAJECTORIES = "init", "traj"
_SEEDED: Final = re.compile(r"(?P<name>.+)-seed(?P<seed>\d+)")
_LABELS: Final = {
    GROUND_TRUTH: "GT",
    "constant-velocity": "constant velocity",
    "lane-follower": "lane follower",
    "mha": "MHA",
    "pd_minus_cdb": "PD - CDB",
    "vd": "VD",
    "pd_minus_p": "PD - P",
    "pd": "PD",
    "paper": "PD as in the paper",
    "pd_with_warps": "PD trained with warps",
    "path-diffuser": "PD, shipped weights",
    "path-diffuser-without-warps": "PD without warps, shipped weights",
}
"""Labels of the known systems, in the order of the tables."""
REFERENCES: Final = (GROUND_TRUTH, "constant-velocity", "lane-follower")


@dataclass(frozen=True, kw_only=True)
class Trained:
    """One trained model of a system."""

    system: str
    seed: int
    method: str
    """Name as a method: a folder, or a shipped generator."""
    stages: tuple[str, ...]
    """The stages that are the system's own; others are borrowed from PD."""
    warp_share: float = 0.0
    """Share of warped roads in the training of the trajectories."""
    start: str = ""
    """Name of the model that the training of the trajectories started from."""
    saw_warps: bool = False
    """Whether the trajectories were ever trained on warped roads, before it as well."""


def label_of(system: str) -> str:
    """Label of a system in tables and figures."""
    return _LABELS.get(system, system)


def in_table_order(systems: Iterable[str]) -> tuple[str, ...]:
    """Systems without duplicates: the known ones first."""
    known = list(_LABELS)
    return tuple(
        sorted(
            dict.fromkeys(systems),
            key=lambda name: (known.index(name) if name in known else len(known), name),
        )
    )


def trained_systems(
    roots: Sequence[Path], shipped: Sequence[tuple[str, Path]] = ()
) -> tuple[Trained, ...]:
    """Find the models of folders; ``NAME-seedK`` is system NAME, trained with seed K.

    Roots are folders of models, or of such folders; ``shipped`` are names and folders
    of generators of the program.

    Raises:
        InputError: a root holds no model.
    """
    found = [_trained(folder, name) for name, folder in shipped]
    for root in roots:
        folders = [root] if os.path.isfile(root / CONFIG_NAME) else []
        if not folders and os.path.isdir(root):
            folders = sorted(
                path.parent
                for path in root.glob(f"*/{CONFIG_NAME}")
                if _stages_of(path.parent)
            )
        if not folders:
            raise InputError(
                f"{root}: holds no trained model; expected {CONFIG_NAME} in it or in the "
                "folders directly in it."
            )
        known = {Path(os.path.realpath(place)) for _, place in shipped}
        found += [
            _trained(one) for one in folders if Path(os.path.realpath(one)) not in known
        ]
    return tuple(found)


def _trained(folder: Path, name: str = "") -> Trained:
    stages = _stages_of(folder)
    seeded = _SEEDED.fullmatch(folder.name)
    runs = folder / RUNS_NAME
    own = tuple(
        stage
        for stage in stages
        if not os.path.isdir(runs) or os.path.isdir(runs / stage)
    )
    record = stages.get(TRAJECTORIES, {}).get("training", {})
    return Trained(
        system=name
        or (seeded["name"] if seeded else os.path.basename(os.path.realpath(folder))),
        seed=int(seeded["seed"]) if seeded else 0,
        method=name or str(folder),
        stages=own,
        warp_share=warp_share(record),
        start=str(record.get("start", "")),
        saw_warps=saw_warps(record),
    )


def _stages_of(folder: Path) -> dict[str, Any]:
    """Stages of a model folder by name; empty if it is none."""
    try:
        content = json.loads(
            read_regular(folder / CONFIG_NAME, max_bytes=MAX_CONFIG_BYTES)
        )
    except (InputError, ValueError, RecursionError):
        return {}
    stages = content.get("stages") if isinstance(content, dict) else None
    return stages if isinstance(stages, dict) else {}
