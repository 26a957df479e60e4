"""Path Diffuser Editor: traffic scenarios on real and perturbed roads.

The commands of the shell are functions of the same names. Each takes the scenario
(a demo's name or an Argoverse 2 folder), writes into ``out`` and returns an ``Outcome``
with the folders, the scenarios and remarks::

    import pd_editor

    warped = pd_editor.warp("signalised-junction", kind="smooth-turn", power=6, out="out")
    pd_editor.generate(warped.folder, samples=2, seed=1, out="trajectories")
    pd_editor.replay(warped.folder / "recipe.json", out="again")
    pd_editor.export("winding-street", out="copy", verify=True)
    pd_editor.edit("signalised-junction")  # serves until interrupted

``evaluate`` takes roots of datasets instead, and returns an ``Evaluation``::

    pd_editor.evaluate(data="argoverse/val", warps=("all",), out="table")

So does ``study``, which returns a ``Study``::

    pd_editor.study(data="argoverse/val", search=54, out="study")

``index`` reads what happens in scenes, ``find`` looks them up::

    pd_editor.index("argoverse/val", out="val.index.parquet")
    pd_editor.find("val.index.parquet", "cut-in and density > 20").scenes

``library`` holds the functions that keep scenarios in a folder::

    pd_editor.library.add("kept", (warped.folder, "roundabout"), tags=("paper",))
    pd_editor.library.find("kept", "cut-in").scenes

``synth`` takes none; it makes scenarios of simulated traffic, and returns a ``Synthesis``::

    pd_editor.synth(num=100, seed=1, out="synthetic")

``train`` trains a stage of the model on such roots, ``model`` joins both stages::

    pd_editor.train("traj", data="synthetic", out="runs/traj")
    pd_editor.model(init="runs/init", traj="runs/traj", out="models/mine")

Without files: ``open_scenario`` reads a ``Scenario``, an ``EditorSession`` edits it with
the classes in ``commands``, its ``recipe()`` is a ``Recipe``. Whatever a user or a file
can cause raises a ``PdEditorError``. All of this is loaded on first use.
"""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pd_editor.base.errors import PdEditorError
    from pd_editor.base.installed_files import demo_names
    from pd_editor.cli import library
    from pd_editor.cli.convert import convert
    from pd_editor.cli.doctor import doctor
    from pd_editor.cli.drive import drive
    from pd_editor.cli.edit import edit
    from pd_editor.cli.evaluate import evaluate
    from pd_editor.cli.export import export
    from pd_editor.cli.family import family
    from pd_editor.cli.find import find
    from pd_editor.cli.generate import generate
    from pd_editor.cli.index import index
    from pd_editor.cli.model import model
    from pd_editor.cli.output import Outcome
    from pd_editor.cli.render import render
    from pd_editor.cli.replay import replay
    from pd_editor.cli.study import study
    from pd_editor.cli.synth import synth
    from pd_editor.cli.threats import threats
    from pd_editor.cli.train import train
    from pd_editor.cli.warp import warp
    from pd_editor.editor import commands
    from pd_editor.editor.recipe import Recipe
    from pd_editor.editor.scenario_store import open_scenario
    from pd_editor.editor.session import EditorSession
    from pd_editor.scene.formats.player import Player
    from pd_editor.scene.formats.registry import add_formats
    from pd_editor.scene.scenario import Scenario

__all__ = [
    "EditorSession",
    "Outcome",
    "PdEditorError",
    "Player",
    "Recipe",
    "Scenario",
    "add_formats",
    "commands",
    "convert",
    "demo_names",
    "doctor",
    "drive",
    "edit",
    "evaluate",
    "export",
    "family",
    "find",
    "generate",
    "index",
    "library",
    "model",
    "open_scenario",
    "render",
    "replay",
    "study",
    "synth",
    "threats",
    "train",
    "warp",
]

# Compute threads sleep when they wait, after a few microseconds. They would spin while other
# programs, such as the browser that draws the scene, need the core. Torch's libraries read
# this when they are loaded: GNU's (Linux) and LLVM's (macOS).
os.environ.setdefault("GOMP_SPINCOUNT", "1000")
os.environ.setdefault("KMP_BLOCKTIME", "0")

_HOMES = {
    "EditorSession": "pd_editor.editor.session",
    "Outcome": "pd_editor.cli.output",
    "PdEditorError": "pd_editor.base.errors",
    "Player": "pd_editor.scene.formats.player",
    "Recipe": "pd_editor.editor.recipe",
    "Scenario": "pd_editor.scene.scenario",
    "add_formats": "pd_editor.scene.formats.registry",
    "convert": "pd_editor.cli.convert",
    "demo_names": "pd_editor.base.installed_files",
    "doctor": "pd_editor.cli.doctor",
    "drive": "pd_editor.cli.drive",
    "edit": "pd_editor.cli.edit",
    "evaluate": "pd_editor.cli.evaluate",
    "export": "pd_editor.cli.export",
    "family": "pd_editor.cli.family",
    "find": "pd_editor.cli.find",
    "generate": "pd_editor.cli.generate",
    "index": "pd_editor.cli.index",
    "model": "pd_editor.cli.model",
    "open_scenario": "pd_editor.editor.scenario_store",
    "render": "pd_editor.cli.render",
    "replay": "pd_editor.cli.replay",
    "study": "pd_editor.cli.study",
    "synth": "pd_editor.cli.synth",
    "threats": "pd_editor.cli.threats",
    "train": "pd_editor.cli.train",
    "warp": "pd_editor.cli.warp",
}
_MODULES = {
    "commands": "pd_editor.editor.commands",
    "library": "pd_editor.cli.library",
}


def __getattr__(name: str) -> Any:
    """Import the object of a public name on first access."""
    if name in _MODULES:
        return import_module(_MODULES[name])
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    """Public names, and the modules loaded so far."""
    return sorted({*globals(), *__all__})
