"""Players, films and figures of real scenes: time and size.

``python -m benchmarks.pictures [COUNT]``, with PD_EDITOR_AV2; medians over the first scenes of
``val``, each drawn once in each format.
"""

import os
import sys
import time
from pathlib import Path
from statistics import median

from benchmarks.figures import load_in_words
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.formats.pictures import LOOKS, picture
from pd_editor.scene.formats.player import player_page
from pd_editor.scene.scenario import Scenario


def drawn(scenario: Scenario, ending: str) -> bytes:
    """The file of a scene with an ending."""
    if ending == "html":
        return player_page([scenario])
    return picture(scenario, ending, LOOKS[ending])


def main() -> None:
    """Measure."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 8
    folders = sorted((Path(os.environ["PD_EDITOR_AV2"]) / "val").glob("*/"))[:count]
    scenarios = [open_scenario(one) for one in folders]
    picture(scenarios[0], "svg", LOOKS["svg"])  # Its imports are not measured.
    counts = [len(one.agents) for one in scenarios]
    print(f"{len(scenarios)} scenes of {min(counts)} to {max(counts)} agents")
    for ending in ("html", *LOOKS):
        times, spent, sizes = [], [], []
        for scenario in scenarios:
            begin, before = time.perf_counter(), time.process_time()
            sizes.append(len(drawn(scenario, ending)) / 1e3)
            times.append(time.perf_counter() - begin)
            spent.append(time.process_time() - before)
        print(
            f"{ending}: {median(times):.2f} s, at most {max(times):.2f}; "
            f"{median(spent):.2f} of processor; "
            f"{median(sizes):.0f} kB, at most {max(sizes):.0f}"
        )
    print(load_in_words())


if __name__ == "__main__":
    main()
