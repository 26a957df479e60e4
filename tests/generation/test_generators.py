import hashlib
import json
import os
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pd_editor.base.errors import GenerationError
from pd_editor.generation.generators import (
    DEFAULT_GENERATOR,
    GENERATORS,
    MODEL_CONFIG,
    SHIPPED_MODEL,
    catalogue_with,
    make_generator,
    shipped_models,
)
from pd_editor.scene.generation import CAPABILITIES, ScenarioGenerator


@pytest.mark.parametrize("name", GENERATORS)
def test_each_is_made_by_the_name_it_has(name: str):
    generator = make_generator(name)
    assert isinstance(generator, ScenarioGenerator)
    assert generator.name == name


def test_the_default_is_one_of_them():
    assert DEFAULT_GENERATOR in GENERATORS


def test_the_pair_that_never_saw_a_warped_road_says_so():
    assert shipped_models() == (SHIPPED_MODEL, "path-diffuser-without-warps")
    warped, plain = (GENERATORS[name].origin for name in shipped_models())
    assert warped == "shipped with the editor"
    assert plain == "shipped, never saw a warped road"


def test_a_gpu_is_asked_for_in_vain(monkeypatch: pytest.MonkeyPatch):
    torch = pytest.importorskip("torch")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    for name in GENERATORS:
        if name == "lane-follower":
            assert make_generator(name, device="cuda").name == name
        else:
            with pytest.raises(GenerationError, match="GPU"):
                make_generator(name, device="cuda")


def test_others_are_refused():
    with pytest.raises(GenerationError, match="There is no generator 'crystal-ball'"):
        make_generator("crystal-ball")


def model_folder(path: Path, config: str = "", stage: str = "init") -> Path:
    path.mkdir(parents=True)
    listed = {"stages": {stage: {"sha256": hashlib.sha256(b"weights").hexdigest()}}}
    (path / MODEL_CONFIG).write_text(config or json.dumps(listed))
    (path / "initial_states.safetensors").write_bytes(b"weights")
    return path


def test_models_of_a_users_own_come_first(tmp_path: Path):
    folders = [model_folder(tmp_path / name) for name in ("mine", "other")]
    offers = catalogue_with(folders).offers
    assert list(offers) == ["mine", "other", *GENERATORS]
    assert [offers[name].make().name for name in ("mine", "other")] == ["mine", "other"]
    assert offers["mine"].origin == str(folders[0])
    assert catalogue_with(()).offers == GENERATORS


def test_a_folder_of_models_offers_each_and_lists_the_broken_ones(tmp_path: Path):
    for name in ("a", "b"):
        model_folder(tmp_path / name)
    model_folder(tmp_path / "damaged", "{")
    model_folder(tmp_path / "odd", "[]")
    (model_folder(tmp_path / "weightless") / "initial_states.safetensors").unlink()
    (model_folder(tmp_path / "cut") / "initial_states.safetensors").write_bytes(b"wei")
    (tmp_path / "notes").mkdir()
    found = catalogue_with([tmp_path])
    # (W16) None of several is preferred: the default stays, and is still the first.
    assert list(found.offers)[: len(GENERATORS) + 2] == [*GENERATORS, "a", "b"]
    mine = model_folder(tmp_path / "more" / "mine")
    assert next(iter(catalogue_with([tmp_path, mine]).offers)) == "mine"
    reasons = {one.name: one.reason for one in found.unusable}
    assert reasons == {
        "damaged": "config.json is not readable JSON",
        "odd": "config.json lists no stages",
        "cut": "the weights of the stage init are not those that config.json lists: "
        "missing, damaged or of another model",
        "weightless": "the weights (*.safetensors) are missing",
    }


def test_a_model_without_initial_states_samples_none(tmp_path: Path):
    whole, half = (
        model_folder(tmp_path / "a"),
        model_folder(tmp_path / "b", stage="traj"),
    )
    offers = catalogue_with([whole, half]).offers
    assert offers["a"].supports == CAPABILITIES
    assert offers["b"].supports == {"guidance"}


def test_folders_that_are_no_models_are_refused(tmp_path: Path):
    with pytest.raises(GenerationError, match="not a trained model; expected a folder"):
        catalogue_with([tmp_path])


@pytest.mark.parametrize("taken", [DEFAULT_GENERATOR, "mine"])
def test_two_generators_of_one_name_are_refused(tmp_path: Path, taken: str):
    folders = [model_folder(tmp_path / parent / taken) for parent in ("a", "b")]
    with pytest.raises(GenerationError, match="already; rename the folder"):
        catalogue_with(folders)


def test_a_reference_is_offered_once(tmp_path: Path):
    reference = "examples.drift_generator:DriftGenerator"
    offer = catalogue_with([reference]).offers[reference]
    assert offer.make().name == "drift"
    assert offer.origin == "your own code: trajectories only"
    with pytest.raises(GenerationError, match="already; name it once"):
        catalogue_with([reference, reference])


ODD_NEIGHBOURS = {
    "pipe": os.mkfifo,
    "folder": os.mkdir,
    "circle": lambda path: os.symlink(path, path),
    "endless": lambda path: os.symlink("/dev/zero", path),
    "dangling": lambda path: os.symlink("nowhere", path),
    "huge": lambda path: os.truncate(os.open(path, os.O_CREAT | os.O_WRONLY), 2**40),
}
LISTED = {"stages": {"init": {"sha256": hashlib.sha256(b"weights").hexdigest()}}}


@pytest.mark.parametrize("kind", ODD_NEIGHBOURS)
@pytest.mark.parametrize("names_file", [False, True])
def test_what_lies_beside_the_weights_is_not_read(
    tmp_path: Path, kind: str, names_file: bool
):
    """Listing a folder hung at a pipe, and read gigabytes of a link to /dev/zero."""
    listed = json.loads(json.dumps(LISTED))
    if names_file:
        listed["stages"]["init"]["file"] = "initial_states.safetensors"
    folder = model_folder(tmp_path / "mine", json.dumps(listed))
    ODD_NEIGHBOURS[kind](str(folder / "a.safetensors"))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert "mine" in catalogue_with([folder]).offers
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 2**16


@pytest.mark.parametrize("kind", ODD_NEIGHBOURS)
@pytest.mark.parametrize("place", ["initial_states.safetensors", MODEL_CONFIG])
def test_odd_files_instead_of_its_own_make_a_folder_unusable(
    tmp_path: Path, kind: str, place: str
):
    folder = model_folder(tmp_path / "mine")
    (folder / place).unlink()
    ODD_NEIGHBOURS[kind](str(folder / place))
    model_folder(tmp_path / "good")
    found = catalogue_with([tmp_path])
    assert "good" in found.offers
    assert "mine" not in found.offers


@pytest.mark.parametrize(
    ("config", "reason"),
    [
        ("[" * 100_000, "not readable JSON"),
        ('{"stages": ' * 50_000 + "1" + "}" * 50_000, "not readable JSON"),
        ("\xff", "not readable JSON"),
        (" " * 2**21, "not readable JSON"),
        ("7", "lists no stages"),
        ("{}", "lists no stages"),
        ('{"stages": [1]}', "lists no stages"),
        ('{"stages": {"init": 5}}', "missing, damaged or of another model"),
        ('{"stages": {"init": {"sha256": [1]}}}', "missing, damaged or of another"),
        ('{"stages": {"init": {"sha256": ""}}}', "missing, damaged or of another"),
        (
            json.dumps({"stages": {"i": {**LISTED["stages"]["init"], "file": "../x"}}}),
            "",
        ),
        (
            json.dumps({"stages": {"i": {"sha256": "", "file": "/dev/zero"}}}),
            "missing, damaged or of another",
        ),
        (
            json.dumps({"stages": {"i\n\x1b[2J": {"sha256": "x"}}}),
            r"the stage i\n\x1b[2J are not",
        ),
    ],
)
def test_a_strange_config_is_told(tmp_path: Path, config: str, reason: str):
    folder = model_folder(tmp_path / "mine", config)
    found = catalogue_with([folder])
    assert ("mine" in found.offers) is not bool(reason)
    assert all(reason in one.reason for one in found.unusable)


def test_weights_that_are_all_zero_are_refused_in_one_sentence(tmp_path: Path):
    """A trained network never has them; the shipped one with zeros divided by zero."""
    torch = pytest.importorskip("torch")
    from safetensors import safe_open
    from safetensors.torch import save_file

    from pd_editor.base.installed_files import models_folder

    folder = tmp_path / "zeros"
    shutil.copytree(models_folder() / SHIPPED_MODEL, folder)
    config = json.loads((folder / MODEL_CONFIG).read_bytes())
    for stage in config["stages"].values():
        path = folder / stage["file"]
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata()
            zeros = {
                name: torch.zeros_like(file.get_tensor(name)) for name in [*file.keys()]
            }
        save_file(zeros, path, metadata)
        stage["sha256"] = hashlib.sha256(path.read_bytes()).hexdigest()
    (folder / MODEL_CONFIG).write_text(json.dumps(config))
    for options in ((), ("--num-agents", "fit")):
        done = subprocess.run(
            [
                *(sys.executable, "-m", "pd_editor", "generate", "crosswalk"),
                *("--model", str(folder), "--out", str(tmp_path / "out"), *options),
            ],
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
        assert "Traceback" not in done.stderr, done.stderr
        assert done.returncode == 2
        assert not (tmp_path / "out").exists()
