"""kill -9 of the editor's server at random moments of a browser session.

``python -m benchmarks.kills [KILLS] [SECONDS] [FOLDER]``. A connection that the
server takes for a browser presses random buttons, moves random sliders and opens random
demos, until the process is killed. Then every edit that the server had accepted must be
in a journal, and whatever export or saved scenario looks whole must be whole. It goes
on where an earlier run with the same folder ended.
"""

import contextlib
import json
import logging
import multiprocessing
import os
import random
import shutil
import signal
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import msgspec
import viser
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from benchmarks.figures import load_in_words
from pd_editor.base.errors import PdEditorError
from pd_editor.base.installed_files import demo_names
from pd_editor.editor.recipe import Recipe
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.editor.unfinished_work import UnfinishedWork, find_unfinished, restore
from tests.viewer.fake_browser import CAMERA

LONGEST_S = 5.0
"""A process is killed at a random moment up to so long after its page is complete."""
START_S = 90.0
OPENS = 0.1
"""Share of actions that open another demo."""
LEFT_ALONE = (
    "Discard",
    "Open folder",
    "Upload",
    "Remove",
    "overlay",
)
"""Buttons that load torch, forget work on purpose, or want a file."""


def serve(library: Path, report: int, log: Path) -> None:
    """The process that is killed: a server that tells what it has accepted."""
    # A study that is started writes its report where the process is.
    os.chdir(library.parent)
    number = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    os.dup2(number, 1)
    os.dup2(number, 2)
    from pd_editor.viewer import viewer_app

    viewer_app.STORAGE_TIMEOUT_S = 0.05
    app = viewer_app.ViewerApp(
        viewer_app.ViewerOptions(reference="crosswalk", port=0, state=library)
    )
    app._warm_up.cancel()
    app._warms_up = True

    def tell(**about: Any) -> None:
        os.write(report, json.dumps(about).encode() + b"\n")

    tell(port=app.server.get_port())
    while not any(tab._built.is_set() for _, tab in tuple(app._tabs.values())):
        time.sleep(0.02)
    (session,) = (workspace.session for workspace in app.workspaces())

    def changed(_before: object, after: Any) -> None:
        if after.is_previewing or session.journal_path is None:
            return
        tell(
            journal=session.journal_path.name,
            labels=[entry.label for entry in session.entries],
            position=after.position,
        )

    session.add_listener(changed)
    (client,) = app.server.get_clients().values()
    controls = []
    for uuid, handle in client.gui._gui_input_handle_from_uuid.items():
        props = handle._impl.props
        controls.append(
            {
                "uuid": uuid,
                "kind": type(handle).__name__,
                "label": getattr(props, "label", ""),
                "low": getattr(props, "min", None),
                "high": getattr(props, "max", None),
                "options": list(getattr(props, "options", ()) or ()),
            }
        )
    tell(controls=controls)
    threading.Event().wait()


def one_kill(folder: Path, seed: int) -> dict[str, int]:
    """A session that ends by a kill; what is found afterwards."""
    dice = random.Random(seed)
    shutil.rmtree(folder, ignore_errors=True)
    library, out = folder / "library", folder / "out"
    out.mkdir(parents=True)
    readable, writable = os.pipe()
    context = multiprocessing.get_context("fork")
    # No daemon: those may not start the processes of a study.
    process = context.Process(target=serve, args=(library, writable, folder / "log"))
    process.start()
    os.close(writable)
    told = Told(readable)
    try:
        port = told.wait_for("port")
        protocols: list[Any] = [f"viser-v{viser.__version__}"]
        address = f"ws://127.0.0.1:{port}"
        with connect(address, subprotocols=protocols, max_size=None) as socket:
            threading.Thread(target=drain, args=(socket,), daemon=True).start()
            socket.send(msgspec.msgpack.encode(CAMERA))
            controls = told.wait_for("controls")
            end = time.monotonic() + dice.uniform(0.0, LONGEST_S)
            with contextlib.suppress(ConnectionClosed):
                play(socket, controls, out, dice, end)
            os.kill(process.pid or 0, signal.SIGKILL)
    finally:
        process.kill()
        process.join()
        told.ended.wait(10)
    counts = found_afterwards(library, out, told.accepted)
    text = (folder / "log").read_text(errors="replace")
    counts["tracebacks"] = text.count("Traceback")
    return counts


class Told:
    """What the server says through its pipe, also what is left in it after a kill."""

    def __init__(self, readable: int) -> None:
        self.accepted: dict[str, dict[str, Any]] = {}
        self._said: dict[str, Any] = {}
        self.ended = threading.Event()
        self._readable = readable
        threading.Thread(target=self._read, daemon=True).start()

    def wait_for(self, name: str) -> Any:
        end = time.monotonic() + START_S
        while name not in self._said:
            assert time.monotonic() < end, f"the server does not tell its {name}"
            time.sleep(0.01)
        return self._said[name]

    def _read(self) -> None:
        with os.fdopen(self._readable, "rb") as pipe:
            for line in pipe:
                if not line.endswith(b"\n"):
                    break
                said = json.loads(line)
                self._said |= said
                if "journal" in said:
                    self.accepted[said["journal"]] = said
        self.ended.set()


def drain(socket: Any) -> None:
    with contextlib.suppress(ConnectionClosed, OSError):
        while True:
            socket.recv()


def play(
    socket: Any, controls: list[Any], out: Path, dice: random.Random, end: float
) -> None:
    """Use random controls, as a browser's messages do."""

    def send(uuid: str, value: Any) -> None:
        message = {
            "type": "GuiUpdateMessage",
            "uuid": uuid,
            "updates": {"value": value},
        }
        socket.send(msgspec.msgpack.encode(message))

    usable = [one for one in controls if not str(one["label"]).startswith(LEFT_ALONE)]
    often = [
        one
        for one in usable
        if str(one["label"]).startswith(
            ("Bend", "S-bend", "Waves", "Undo", "Redo", "Save to", "Write to")
        )
        or "turn" in str(one["label"]).lower()
    ]
    named = {one["label"]: one["uuid"] for one in controls}
    send(named["Into folder"], str(out))
    while time.monotonic() < end:
        if dice.random() < OPENS:
            send(named["All scenarios"], True)
            for kind, value in ("source", "demos"), ("open", dice.choice(demo_names())):
                event = {"kind": kind, "value": value}
                said = json.dumps({"element": "startPage", "event": event})
                send(named["overlay"], said)
        one = dice.choice(often if often and dice.random() < 0.6 else usable)
        kind = one["kind"]
        if one["options"]:
            send(one["uuid"], dice.choice(one["options"]))
        elif "Button" in kind:
            send(one["uuid"], True)
        elif kind == "GuiSliderHandle" and isinstance(one["low"], int | float):
            send(one["uuid"], round(dice.uniform(one["low"], one["high"]), 1))
        elif "Checkbox" in kind:
            send(one["uuid"], dice.random() < 0.5)
        # A slider that rests for a second is an edit.
        time.sleep(dice.choice((0.02, 0.05, 0.05, 1.1)))


def _is_as_told(work: UnfinishedWork, said: dict[str, Any]) -> bool:
    """Whether a journal leads to the labels and the position that the server told."""
    session = restore(work, open_scenario(work.base.source))
    labels = [entry.label for entry in session.entries]
    position = session.state.position
    session.close()
    return labels == said["labels"] and position == said["position"]


def _is_one_ahead(work: UnfinishedWork, said: dict[str, Any]) -> bool:
    """Whether just the last edit or move in a journal had not been told yet.

    The server writes first: a kill may come before it tells.
    """
    lines = work.path.read_bytes().splitlines(keepends=True)
    while b'"do": "describe"' in lines[-1]:
        lines.pop()
    work.path.write_bytes(b"".join(lines[:-1]))
    return _is_as_told(work, said) if len(lines) > 2 else not said["position"]


def found_afterwards(
    library: Path, out: Path, accepted: dict[str, dict[str, Any]]
) -> dict[str, int]:
    """Compare what the server had accepted with what is on disk.

    ``ahead`` counts journals that hold one edit or move more than was told.
    """
    names = ("edits", "journals", "lost", "ahead", "whole", "torn")
    counts: dict[str, int] = dict.fromkeys(names, 0)
    works = {work.path.name: work for work in find_unfinished(library / "journals")}
    for name, said in accepted.items():
        if not said["labels"]:
            continue
        counts["journals"] += 1
        counts["edits"] += len(said["labels"])
        if name not in works:
            counts["lost"] += 1
            continue
        if not _is_as_told(works[name], said):
            counts["ahead" if _is_one_ahead(works[name], said) else "lost"] += 1
    for place in (out, library / "library"):
        for folder in sorted(place.iterdir()) if place.is_dir() else ():
            if folder.name.startswith("."):
                continue
            try:
                scenario = open_scenario(folder)
                recipe = Recipe.from_text((folder / "recipe.json").read_bytes())
                is_whole = scenario.scenario_id == recipe.result_id
            except (OSError, PdEditorError):
                is_whole = False
            counts["whole" if is_whole else "torn"] += 1
    return counts


def main() -> None:
    """Kill, look, and again."""
    wanted = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 1500.0
    folder = Path(sys.argv[3] if len(sys.argv) > 3 else tempfile.mkdtemp()).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    logging.disable(logging.WARNING)
    import pd_editor.viewer.viewer_app  # noqa: F401  (each process has it by forking)

    state_file = folder / "state.json"
    state: dict[str, int] = {"kills": 0}
    if state_file.exists():
        state = json.loads(state_file.read_text())
    end = time.monotonic() + seconds
    while state["kills"] < wanted and time.monotonic() < end:
        counts = one_kill(folder / "round", state["kills"])
        state["kills"] += 1
        for name, count in counts.items():
            state[name] = state.get(name, 0) + count
        state_file.write_text(json.dumps(state))
        if counts["lost"] or counts["torn"] or counts["tracebacks"] or counts["ahead"]:
            shutil.copytree(folder / "round", folder / f"bad-{state['kills']}")
    print(f"{state}. {load_in_words()}")


if __name__ == "__main__":
    main()
