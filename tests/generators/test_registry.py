import hashlib
import json
from pathlib import Path

import pytest

from pd_editor.errors import GenerationError
from pd_editor.generation import CAPABILITIES, ScenarioGenerator
from pd_editor.generators import (
    DEFAULT_GENERATOR,
    GENERATORS,
    MODEL_CONFIG,
    SHIPPED_MODEL,
    catalogue_with,
    make_generator,
    shipped_models,
)


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
