"""A process that edits, says when it has, and waits to be killed."""

import sys
import time
from pathlib import Path

from pd_editor.editor.commands import TransformAgents
from pd_editor.editor.session import EditorSession
from pd_editor.editor.unfinished_work import Journal
from tests.editor.command_strategies import busy_scenario


def main() -> None:
    session = EditorSession(
        busy_scenario(),
        journal=Journal(Path(sys.argv[1])),
        base_files={"map.json": b"{}", "tracks.parquet": b"PAR1"},
    )
    for step in range(7):
        session.select(("100", "101")[: step % 3])
        session.apply(TransformAgents(agent_ids=("100",), dx_m=1.0 + step))
    session.undo()
    session.undo()
    session.redo()
    session.begin_gesture()
    session.preview(TransformAgents(agent_ids=("100",), dx_m=100.0))
    sys.stdout.write("edited\n")
    sys.stdout.flush()
    time.sleep(60)


if __name__ == "__main__":
    main()
