"""Draws the demo scenarios: ``python -m assets.demos.draw_demos [FOLDER]``."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final

from assets.demos.signalised_junction import signalised_junction
from assets.demos.winding_street import winding_street
from pd_editor.av2_io.write import scenario_files
from pd_editor.scene.scenario import Scenario

DEMOS: Final[dict[str, Callable[[], Scenario]]] = {
    "signalised-junction": signalised_junction,
    "winding-street": winding_street,
}


def draw_demos(folder: Path) -> None:
    """Write every demo as an Argoverse 2 scenario folder."""
    for name, drawn in DEMOS.items():
        (folder / name).mkdir(parents=True, exist_ok=True)
        for file_name, content in scenario_files(drawn()).items():
            (folder / name / file_name).write_bytes(content)


if __name__ == "__main__":
    draw_demos(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
