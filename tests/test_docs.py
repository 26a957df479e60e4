"""The documentation builds, with the reference made of the docstrings."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.slow
def test_the_documentation_builds_without_a_warning(tmp_path: Path):
    command = ["-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", tmp_path]
    done = subprocess.run(
        [sys.executable, *map(str, command)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    pages = {path.name: path.read_text() for path in tmp_path.rglob("*.html")}
    assert "Path Diffuser Editor" in pages["index.html"]
    for page, name in (
        ("python.html", "pd_editor.editor.session.EditorSession"),
        ("commands.html", "pd_editor.editor.commands.road.SetRoadWarp"),
        ("generation.html", "pd_editor.scene.generation.ScenarioGenerator"),
        ("metrics.html", "min_ade"),
    ):
        assert name in pages[page]
