"""kill -9 of those who save, tag, export and index a library, two at once.

``python -m benchmarks.library_kills [KILLS]`` kills so many times at each of the four.
What one of them had told as done must be there afterwards, and all that is there whole.
"""

import multiprocessing
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from multiprocessing.connection import Connection
from pathlib import Path

import pd_editor
from benchmarks.figures import load_in_words
from pd_editor.base.errors import PdEditorError
from pd_editor.editor.commands import TransformAgents
from pd_editor.editor.library.library import Library, take_in
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.editor.session import EditorSession

WORK = ("save", "tag", "export", "index")
NAMES = ("crosswalk", "roundabout")
LONGEST_S = 0.6
"""A process is killed at a random moment up to so long after its first work is done."""


def make(folder: Path) -> None:
    """A library of two scenarios."""
    pd_editor.library.add(folder, NAMES)


def work_for_ever(folder: Path, what: str, who: str, told: Connection) -> None:
    """What is killed; tells what is done."""
    library, session = Library(folder), EditorSession(open_scenario("crosswalk"))
    number, out = 0, folder.with_name(f"out-{who}")
    while True:
        number += 1
        mark = f"{who}{number}"
        if what == "save":
            focal = session.scenario.focal_id
            way = 0.01 if who == "a" else 0.013  # Equal scenes are taken in once.
            session.apply(TransformAgents(agent_ids=(focal,), dx_m=way))
            told.send(take_in(library, session, "crosswalk", tags=(mark,)))
        elif what == "tag":
            pd_editor.library.tag(folder, "*", add=(mark,))
            told.send(mark)
            if number > 1:
                pd_editor.library.tag(folder, "*", remove=(f"{who}{number - 1}",))
        elif what == "export":
            pd_editor.library.export(folder, "*", out=out, overwrite=True)
            told.send(mark)
        else:
            file = folder.with_name(f"{who}.parquet")
            pd_editor.index(folder, out=file)
            told.send(mark)
            file.unlink()


def one_kill(folder: Path, what: str, seed: int) -> list[str]:
    """Kill two at once; what is wrong afterwards."""
    dice, said = random.Random(seed), dict[str, list[str]]()
    context = multiprocessing.get_context("fork")
    both = []
    for who in ("a", "b"):
        here, there = context.Pipe(duplex=False)
        arguments = (folder, what, who, there)
        process = context.Process(target=work_for_ever, args=arguments)
        process.start()
        there.close()
        both.append((who, process, here))
    for who, _, here in both:
        said[who] = [here.recv()]
    time.sleep(dice.uniform(0.0, LONGEST_S))
    for who, process, here in both:
        os.kill(process.pid or 0, signal.SIGKILL)
        process.join()
        while here.poll():
            try:
                said[who].append(here.recv())
            except (EOFError, OSError):
                break
    return _faults(folder, what, said)


def _faults(folder: Path, what: str, said: dict[str, list[str]]) -> list[str]:
    checked, cards = pd_editor.library.check(folder), Library(folder).cards()
    names = {card.name for card in cards}
    wrong = [f"{name} is torn" for name in checked.failures]
    wrong += [f"{name} is lost" for name in NAMES if name not in names]
    for who, done in said.items():
        if what == "save":
            wrong += [f"{name} is lost" for name in done if name not in names]
        elif what == "tag":
            ends = {done[-1], f"{who}{len(done) + 1}"}
            wrong += [
                f"{done[-1]} is lost" for one in cards if not ends & set(one.row.tags)
            ]
        elif what == "export":
            for name in NAMES:
                try:
                    open_scenario(folder.with_name(f"out-{who}") / name)
                except PdEditorError as error:
                    wrong.append(str(error))
        elif (file := folder.with_name(f"{who}.parquet")).exists():
            pd_editor.find(file, "agents > 0")
            if pd_editor.index(folder, out=file).num_scenes != len(NAMES):
                wrong.append(f"{file} is not continued")
    return wrong


def main() -> None:
    """Kill, look, and again."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    with tempfile.TemporaryDirectory() as place:
        model = Path(place) / "model"
        make(model)
        for what in WORK:
            wrong: list[str] = []
            for seed in range(count):
                folder = Path(place) / "round" / "library"
                shutil.copytree(model, folder)
                wrong += one_kill(folder, what, seed)
                shutil.rmtree(folder.parent)
            print(f"{what}: {count} kills of two, {len(wrong)} faults", *wrong[:3])
    print(load_in_words())


if __name__ == "__main__":
    main()
