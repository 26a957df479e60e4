"""What is usual in recordings: quantiles of the scorecard's metrics over scenes.

Reads the train folder under PD_EDITOR_AV2; ``--write`` replaces the package's table.
"""

import csv
import os
import sys
import time
from pathlib import Path

import numpy as np

from pd_editor.analysis.findings import scorecard as scorecard_module
from pd_editor.analysis.findings.scorecard import ROWS, UsualRange, scorecard
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.palette import LIGHT
from pd_editor.viewer.findings.scorecard_drawer import finding_primitives
from pd_editor.viewer.meshes.flat_mesh import glb_of

TARGET = Path(scorecard_module.__file__).with_name("usual_values.csv")
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
FIELDS = ("low", "quarter", "median", "three_quarters", "high")
NOTHING = UsualRange(low=0, quarter=0, median=0, three_quarters=0, high=0, num_scenes=0)


def main() -> None:
    """Print the table, and the processor time of a scorecard and of drawing it."""
    root = Path(os.environ["PD_EDITOR_AV2"]) / "train"
    if not TARGET.exists():
        scorecard_module.usual_ranges = lambda: dict.fromkeys(ROWS, NOTHING)
    means, times, drawn = [], [], []
    for folder in sorted(path.parent for path in root.glob("*/scenario*.parquet")):
        scenario = read_scenario(folder)
        scorecard(scenario)
        began = time.thread_time()
        means.append({row.name: row.value for row in scorecard(scenario)})
        times.append(1e3 * (time.thread_time() - began))
        found = [one for row in scorecard(scenario) for one in row.findings]
        began = time.thread_time()
        glb_of(finding_primitives(scenario, [f for f in found if f.is_fault], LIGHT))
        drawn.append(1e3 * (time.thread_time() - began))
    rows = []
    for name in ROWS:
        values = np.array([one[name] for one in means])
        values = values[np.isfinite(values)]
        quantiles = np.quantile(values, QUANTILES).round(4)
        cells = dict(zip(FIELDS, quantiles.tolist(), strict=True))
        rows.append({"name": name, **cells, "num_scenes": len(values)})
    target = TARGET.open("w", newline="") if "--write" in sys.argv else sys.stdout
    table = csv.DictWriter(target, ("name", *FIELDS, "num_scenes"), lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    for what, took in (("a scorecard", times), ("its findings drawn", drawn)):
        print(f"{what}: median {np.median(took):.1f} ms, most {max(took):.1f} ms")


if __name__ == "__main__":
    main()
