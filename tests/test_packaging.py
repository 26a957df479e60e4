"""The wheel in an empty environment, and the files that say what is installed."""

import importlib.metadata
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement

from pd_editor.base.installed_files import demo_names

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def pinned() -> dict[str, str]:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pairs = [line.split("==") for line in lines if not line.startswith("#")]
    return {canonical(name): version for name, version in pairs}


def dev_requirements() -> list[str]:
    """Those of the extra that developers install, the extras it names included."""
    extras = PROJECT["optional-dependencies"]
    return [
        text
        for one in extras["dev"]
        for text in (
            [one]
            if Requirement(one).name != PROJECT["name"]
            else [text for name in Requirement(one).extras for text in extras[name]]
        )
    ]


def needed_by(*requirements: str) -> set[str]:
    """Names of all distributions that requirements lead to in this environment."""
    found: set[str] = set()
    open_ends = [(Requirement(text), "") for text in requirements]
    while open_ends:
        requirement, extra = open_ends.pop()
        marker = requirement.marker
        if marker is not None and not marker.evaluate({"extra": extra}):
            continue
        name = canonical(requirement.name)
        more = importlib.metadata.requires(name) or []
        wanted = {"", *requirement.extras}
        if name not in found or requirement.extras:
            open_ends += [
                (Requirement(text), option) for text in more for option in wanted
            ]
        found.add(name)
    return found


def test_constraints_pin_all_that_is_installed():
    """But for what a build of torch for GPUs brings, which torch itself pins."""
    needed = needed_by(*PROJECT["dependencies"], *dev_requirements())
    assert "torch" in needed
    of_gpu = {
        name for name in needed if name.startswith(("cuda-", "nvidia-", "triton"))
    }
    assert needed - of_gpu <= pinned().keys()


def test_constraints_hold_on_every_machine():
    for name, version in pinned().items():
        assert re.fullmatch(r"[0-9][0-9a-z.]*", version), (name, version)


def test_constraints_lie_within_the_honest_ranges():
    versions = pinned()
    for text in (*PROJECT["dependencies"], *dev_requirements()):
        requirement = Requirement(text)
        version = versions[canonical(requirement.name)]
        assert requirement.specifier.contains(version), text


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built of what ``docker build`` is given."""
    out, source = tmp_path_factory.mktemp("wheel"), tmp_path_factory.mktemp("source")
    for line in (ROOT / ".dockerignore").read_text().splitlines():
        if line.startswith("!"):
            given, place = ROOT / line[1:], source / line[1:]
            place.parent.mkdir(exist_ok=True)
            (shutil.copytree if given.is_dir() else shutil.copy)(given, place)
    command = [
        sys.executable,
        "-m",
        "build",
        "--wheel",
        "--outdir",
        str(out),
        str(source),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (built,) = out.glob("*.whl")
    return built


@pytest.mark.slow
def test_the_wheel_holds_what_is_used_and_no_more(wheel: Path):
    names = zipfile.ZipFile(wheel).namelist()
    for name in demo_names():
        assert f"pd_editor/assets/demos/{name}/scenario_{name}.parquet" in names
        assert f"pd_editor/assets/demos/{name}/log_map_archive_{name}.json" in names
    assert "pd_editor/assets/demos/README.md" in names
    assert "pd_editor/models/README.md" in names
    assert "pd_editor/experiments/report.html.jinja" in names
    assert "pd_editor/analysis/metrics/metric_table.csv" in names
    assert any(name.endswith("licenses/LICENSE") for name in names)
    modules = [name for name in names if name.endswith(".py")]
    assert not [name for name in modules if {"assets", "tests"} & {*name.split("/")}]
    assert {name.split("/")[0] for name in names} == {
        "pd_editor",
        "scene_test",
        f"pd_editor-{PROJECT['version']}.dist-info",
    }


@pytest.mark.slow
def test_the_wheel_works_in_an_environment_of_its_own(
    wheel: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.delenv("PYTHONPATH", raising=False)
    environment = tmp_path / "environment"
    subprocess.run(
        [sys.executable, "-m", "venv", "--without-pip", environment], check=True
    )
    (site,) = environment.glob("lib/python*/site-packages")
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps"]
    subprocess.run([*install, "--target", site, wheel], check=True)
    # What it depends on is borrowed from here; a path file's lines come after the
    # environment's own packages and do not follow the checkout's path file.
    here = importlib.metadata.distribution("numpy").locate_file("")
    (site / "borrowed.pth").write_text(f"{here}\n")
    python = environment / "bin" / "python"
    outside = tmp_path / "elsewhere"
    outside.mkdir()
    code = (
        "import pd_editor; print(pd_editor.__file__); print(*pd_editor.demo_names());"
        "from pd_editor.base.installed_files import models_folder; print(models_folder())"
    )
    found = subprocess.run(
        [python, "-c", code], cwd=outside, capture_output=True, text=True, check=True
    ).stdout.splitlines()
    assert Path(found[0]) == site / "pd_editor" / "__init__.py"
    assert tuple(found[1].split()) == demo_names()
    assert Path(found[2]) == site / "pd_editor" / "models"
    script = [python, site / "bin" / "pd-editor"]
    for arguments in (
        ("export", "signalised-junction", "--out", "out"),
        ("generate", "winding-street", "--out", "out"),
    ):
        done = subprocess.run(
            [*script, *arguments],
            cwd=outside,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        assert (outside / done.stdout.splitlines()[0] / "recipe.json").is_file()


def test_the_citation_is_of_this_version_and_of_the_papers_that_the_readme_cites():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert (cited["version"], cited["license"]) == (
        PROJECT["version"],
        PROJECT["license"],
    )
    titles = [one["title"] for one in cited["references"]]
    _, _, section = (ROOT / "README.md").read_text().partition("## Citation")
    read = re.findall(r"\btitle +=\s*\{(.+)\},|et al\., \*(.+)\*", section)
    assert ["".join(one) for one in read] == titles
