"""Random editor commands over 20 real scenarios, with switches in between.

``python -m benchmarks.random_walks [COMMANDS] [SECONDS] [FOLDER]`` needs
PD_EDITOR_AV2. It goes on where an earlier run with the same folder ended.
"""

import json
import logging
import os
import shutil
import sys
import tempfile
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.figures import load_in_words
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.viewer.state.session_shelf import SessionShelf
from pd_editor.viewer.state.workspace import Workspace
from tests.random_walk import walk

NUM_SCENES = 20
SCENES_OF_A_BLOCK = 4
BLOCK = 250
"""Commands between two checks of everything; sessions stay within what can be undone."""


def main() -> None:
    """Walk block by block, each with a seed of its own."""
    wanted = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 600.0
    folder = Path(sys.argv[3] if len(sys.argv) > 3 else tempfile.mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    logging.disable(logging.WARNING)
    state_file = folder / "state.json"
    state: dict[str, Any] = {
        "blocks": 0,
        "commands": 0,
        "refused": 0,
        "moves": 0,
        "switches": 0,
    }
    state |= {"checked": 0, "seconds": 0.0}
    if state_file.exists():
        state = json.loads(state_file.read_text())
    root = Path(os.environ["PD_EDITOR_AV2"])
    scenes = sorted((root / "train").glob("*/"))
    scenes = scenes[:NUM_SCENES]
    started = time.monotonic()
    while state["commands"] < wanted and time.monotonic() - started < seconds:
        begun = time.monotonic()
        rng = np.random.default_rng([15, state["blocks"]])
        chosen = [scenes[i] for i in rng.permutation(len(scenes))[:SCENES_OF_A_BLOCK]]
        here = folder / "block"
        shutil.rmtree(here, ignore_errors=True)
        workspace = Workspace(
            open_scenario(chosen[0]), dataset=None, shelf=SessionShelf(here)
        )
        counts = walk(workspace, chosen, rng, BLOCK, here / "out")
        workspace.close()
        for name, count in asdict(counts).items():
            state[name] += count
        state["blocks"] += 1
        state["seconds"] += time.monotonic() - begun
        state_file.write_text(json.dumps(state))
    print(
        f"{state['commands']} commands on {NUM_SCENES} real scenarios, {state['refused']}"
        f" refused in a sentence, {state['moves']} jumps along the history,"
        f" {state['switches']} switches; {state['checked']} sessions undone to the start,"
        f" replayed, exported and read back: all equal, one focal track each."
        f" {state['seconds']:.0f} s. {load_in_words()}"
    )


if __name__ == "__main__":
    main()
