"""What importing does and does not do, each in a clean process."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import pd_editor

ROOT = Path(__file__).parents[1]


def loaded_after(statement: str, *names: str) -> set[str]:
    """Which of the named modules a statement loads in a process without a GPU."""
    code = f"{statement}\nimport sys\nprint(*({names!r} & sys.modules.keys()))"
    code = code.replace(repr(names), repr(set(names)))
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        cwd=ROOT,
        env={**os.environ, "CUDA_VISIBLE_DEVICES": ""},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return set(done.stdout.split())


def test_every_module_loads_without_torch_and_av2():
    statement = (
        "import importlib.util, pkgutil, pd_editor\n"
        "found = pkgutil.walk_packages(pd_editor.__path__, 'pd_editor.')\n"
        "parts = 'checkpoints core initial_state inputs path_diffuser request_options '\n"
        "parts += 'samples stages trajectory'\n"
        "torch_users = tuple('pd_editor.generation.' + part for part in parts.split())\n"
        "torch_users += ('pd_editor.experiments.training.',)\n"
        # Of the modules, this one alone needs an extra to be imported.
        "has_gym = importlib.util.find_spec('gymnasium')\n"
        "names = [one.name for one in found if not one.name.endswith('__main__')\n"
        "         and (has_gym or one.name != 'pd_editor.gym')\n"
        "         and not one.name.startswith(torch_users)]\n"
        "assert len(names) > 50, names\n"
        "for name in names:\n"
        "    importlib.import_module(name)"
    )
    assert loaded_after(statement, "torch", "av2", "viser") == {"viser"}


def test_the_browser_editor_loads_without_torch():
    statement = "import pd_editor.viewer.viewer_app"
    assert loaded_after(statement, "torch", "av2", "numba", "matplotlib") == set()


def test_the_shell_loads_without_the_viewer():
    statement = "import pd_editor.cli.main"
    heavy = ("torch", "av2", "viser", "trimesh", "pandas", "scipy", "matplotlib")
    assert loaded_after(statement, *heavy) == set()


@pytest.mark.parametrize("words", [["--help"], ["no-command"], ["warp", "--help"]])
def test_the_shell_imports_the_command_that_is_called(words: list[str]):
    """Only its own command, and for the overview none, so that it is there at once."""
    statement = (
        "import contextlib, io\n"
        "from pd_editor.cli.main import main\n"
        "with contextlib.redirect_stdout(io.StringIO()), "
        "contextlib.redirect_stderr(io.StringIO()):\n"
        f"    main({words!r})"
    )
    others = ("pd_editor.cli.generate", "pd_editor.cli.study", "pd_editor.cli.evaluate")
    heavy = () if words[0] == "warp" else ("numpy", "shapely", "pyarrow", "jaxtyping")
    assert loaded_after(statement, *others, *heavy) == set()


def test_a_scenario_is_read_and_written_without_pandas(tmp_path: Path):
    statement = f"import pd_editor\npd_editor.export('merge', out={str(tmp_path)!r})"
    assert loaded_after(statement, "pandas", "torch") == set()


def test_the_package_itself_loads_nothing():
    heavy = ("numpy", "shapely", "pyarrow", "tyro", "viser", "torch", "av2")
    assert loaded_after("import pd_editor", *heavy) == set()


@pytest.mark.parametrize(("given", "expected"), [({}, "1000"), ({"own": "7"}, "7")])
def test_waiting_threads_sleep_unless_the_user_says_otherwise(given, expected):
    """Spinning ones take the cores of other programs; torch reads it when it is loaded."""
    code = (
        "import os, sys, pd_editor\n"
        "assert 'torch' not in sys.modules\n"
        "print(os.environ['GOMP_SPINCOUNT'], os.environ['KMP_BLOCKTIME'])"
    )
    own = {"GOMP_SPINCOUNT": given["own"], "KMP_BLOCKTIME": "5"} if given else {}
    others = {
        name: value
        for name, value in os.environ.items()
        if name not in ("GOMP_SPINCOUNT", "KMP_BLOCKTIME")
    }
    words = subprocess.check_output(
        [sys.executable, "-c", code], cwd=ROOT, env=others | own, text=True
    )
    assert words.split() == [expected, "5" if given else "0"]


def test_public_names_are_there_and_listed():
    for name in pd_editor.__all__:
        assert getattr(pd_editor, name) is not None
        assert name in dir(pd_editor)
    assert not hasattr(pd_editor, "nothing_of_the_kind")


def test_public_functions_stay_functions_when_modules_are_loaded():
    statement = (
        "import pd_editor, pd_editor.cli.main, pd_editor.viewer.viewer_app\n"
        "for name in ('edit', 'warp', 'generate', 'export', 'replay', 'evaluate'):\n"
        "    assert callable(getattr(pd_editor, name)), name"
    )
    assert loaded_after(statement, "torch") == set()
