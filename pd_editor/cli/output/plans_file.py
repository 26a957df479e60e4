"""What policies planned, in a file beside the folder of a roll-out."""

import json
from pathlib import Path

import numpy as np

from pd_editor.base.errors import InputError
from pd_editor.base.regular_file import json_value, read_regular, write_whole
from pd_editor.scene.policy import DrivenPlans
from pd_editor.scene.scenario import Scenario

_MOST_BYTES = 1 << 26


def _place(folder: Path) -> Path:
    return folder.with_name(f"{folder.name}-plans.json")


def write_plans(folder: Path, plans: DrivenPlans, scenario: Scenario) -> None:
    """Write the plans of a roll-out in the frame of its city, which files keep."""
    origin = scenario.origin_city_m
    data = {
        name: {
            str(at): np.round(line + origin, 2).tolist() for at, line in made.items()
        }
        for name, made in plans.items()
    }
    write_whole(_place(folder), f"{json.dumps(data)}\n".encode())


def read_plans(folder: Path, scenario: Scenario) -> DrivenPlans:
    """The plans beside a folder, in the frame of its scenario; none if there is no file.

    Raises:
        InputError: the file cannot be read, or holds no plans.
    """
    path = _place(folder)
    if not path.exists():
        return {}
    try:
        data = json_value(read_regular(path, max_bytes=_MOST_BYTES))
        plans = {
            name: {
                int(at): np.asarray(line, dtype=float) - scenario.origin_city_m
                for at, line in made.items()
            }
            for name, made in data.items()
        }
    except (ValueError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: holds no plans of pd-editor drive.") from error
    lines = [line for made in plans.values() for line in made.values()]
    if not all(one.ndim == 2 and np.isfinite(one).all() for one in lines):
        raise InputError(f"{path}: holds no plans of pd-editor drive.")
    return plans
