"""Lists and queries of a library of many scenarios.

``python -m benchmarks.library [SCENARIOS]``. Cards, pictures and rows of the index are
those of the demos, many times under other names; the files are links.
"""

import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import pd_editor
from benchmarks.figures import load_in_words
from pd_editor.editor.library.library import CARD_NAME, SORTS, Library, card_content
from pd_editor.experiments.scene_index.index_file import IndexWriter, row_of, stamp_of
from pd_editor.experiments.scene_index.query import find_places

WORDS = ("junction", "miami merge", "nothing-of-this-kind")
QUERIES = ("cut-in", "crossing with pedestrian pet < 3 and density > 5", "speed > 0")


def make(root: Path, count: int) -> None:
    """Make a library of so many scenarios."""
    few = root.with_name("few")
    pd_editor.library.add(few, "demos")
    models = Library(few).cards()
    rows = {one.name: row_of(str(few / one.name)) for one in models}
    for number in range(count):
        card = models[number % len(models)]
        folder = root / f"{card.name}-{number:05d}"
        shutil.copytree(few / card.name, folder, copy_function=os.link)
        (folder / CARD_NAME).unlink()
        row = replace(card.row, scenario_id=folder.name, tags=(f"tag-{number % 97}",))
        content = card_content(replace(card, row=row, saved_at=1e9 + number))
        (folder / CARD_NAME).write_bytes(content)
    scenes = list(map(str, Library(root).scenes()))
    writer = IndexWriter(root / "scenes.index.parquet", scenes)
    for scene in scenes:
        row = rows[Path(scene).name.rsplit("-", 1)[0]]
        writer.add(scene, {**row, "stamp": stamp_of(scene)})
    writer.write()


def told(what: str, runs: Iterable[Callable[[], object]]) -> None:
    """Print the median and the longest time of some runs."""
    times = []
    for run in runs:
        begin = time.perf_counter()
        run()
        times.append(1e3 * (time.perf_counter() - begin))
    times.sort()
    print(f"{what}: {times[len(times) // 2]:.1f} ms, at most {times[-1]:.1f} ms")


def main() -> None:
    """Measure."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "library"
        root.mkdir()
        make(root, count)
        time.sleep(0.2)
        library = Library(root)
        assert len(Library(root).cards()) == count
        told("list of a new process", [lambda: Library(root).cards()] * 3)
        library.cards()
        told("list again", [library.cards] * 20)

        def changed() -> None:
            os.utime(root)
            library.cards()

        told("list after a change", [changed] * 5)
        for text in WORDS:
            told(
                f"words {text!r}, sorted",
                [
                    lambda text=text: sorted(
                        (one for one in library.cards() if one.has(text.split())),
                        key=SORTS["problems"],
                    )
                ]
                * 20,
            )
        scenes = list(map(str, library.scenes()))
        told(
            "index looked at for changes",
            [lambda: IndexWriter(root / "scenes.index.parquet", scenes)] * 3,
        )
        index = IndexWriter(root / "scenes.index.parquet", scenes).index()
        assert len(index.table) == count
        for text in QUERIES:
            told(f"query {text!r}", [lambda text=text: find_places(index, text)] * 20)
    print(load_in_words())


if __name__ == "__main__":
    main()
