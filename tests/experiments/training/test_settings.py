from pathlib import Path

import pytest

from pd_editor.base.errors import TrainingError
from pd_editor.experiments.training.run_config import (
    Augmentation,
    Optimisation,
    RunConfig,
)
from pd_editor.experiments.training.settings import (
    RunRequest,
    StageName,
    continued_config,
    new_config,
    settings_of,
    with_settings,
)
from pd_editor.generation.features.scene_fields import NUM_NEAR_AGENTS

ROOT = Path(__file__).parents[4]
FILE = """
[model]
width = 64

[augmentation]
warp_share = 0.0
jitter_wave_m = [30.0, 90.0]

[traj.model]
num_blocks = 2

[init.model]
is_ordered = false
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "variant.toml"
    path.write_text(FILE)
    return path


def test_a_file_has_values_for_both_stages_and_for_one(file: Path):
    assert settings_of([file], (), "init").of("model") == {
        "width": 64,
        "is_ordered": False,
    }
    assert settings_of([file], (), "traj").of("model") == {"width": 64, "num_blocks": 2}


def test_texts_count_before_the_file(file: Path):
    texts = ("model.width=32", "traj.model.num_blocks=1", "augmentation.warp_share=0.5")
    found = settings_of([file], texts, "traj")
    assert found.of("model") == {"width": 32, "num_blocks": 1}
    assert found.of("augmentation")["warp_share"] == 0.5


def request(file: Path | None = None, *texts: str) -> RunRequest:
    return RunRequest(
        stage="init",
        data=("/data",),
        preset="tiny",
        settings=settings_of([] if file is None else [file], texts, "init"),
    )


def test_a_variant_is_the_preset_with_the_named_fields_changed(file: Path):
    plain = new_config(request(), is_gpu=False)
    variant = new_config(request(file, "optimisation.ema_decay=0.5"), is_gpu=False)
    changed = {name for name in plain.model if plain.model[name] != variant.model[name]}
    assert changed == {"width", "is_ordered"}
    assert variant.augmentation["warp_share"] == 0.0
    assert variant.augmentation["jitter_wave_m"] == (30.0, 90.0)
    assert variant.optimisation.ema_decay == 0.5
    assert plain.augmentation["warp_share"] == Augmentation().warp_share
    assert RunConfig.from_json(variant.to_json()).augmentation["warp_share"] == 0.0


def test_a_run_goes_on_with_its_own_settings_only(file: Path):
    earlier = RunConfig.from_json(new_config(request(file), is_gpu=False).to_json())
    assert continued_config(earlier, request(file)).model == earlier.model
    with pytest.raises(TrainingError, match=r"preset and model\.width; leave"):
        continued_config(earlier, request(file, "model.width=96"))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            "model.widht=96",
            r"--set model.widht=96: \[init.model\] has no field 'widht'; the nearest is width\.",
        ),
        ("modle.width=96", "no section 'modle'; the nearest is model."),
        ("zzz.steps=3", "no section 'zzz'; expected one of model, loss, opt"),
        (
            "sampler.speed_noise=1.1",
            r"\[init.sampler\] has no field 'speed_noise'; expected one of num_steps,",
        ),
        ("sampler.steps=3", r"sampler\] has no field 'steps'; the nearest is num_s"),
        (
            "model.num_blocks=3",
            r"\[init.model\] has no field 'num_blocks'; \[traj.model\] has it",
        ),
        (
            "terms.goal_m=1",
            r"only the stage traj has a section 'terms'; expected \[traj.terms\], or "
            r"traj.terms.NAME=VALUE",
        ),
        ("conflicts.crossing_m=-1", r"\[init.conflicts\] crossing_m is -1; expected"),
        ("guidance.pull=-1", r"\[init.guidance\] pull is -1; expected a finite number"),
        (
            "model.sees_relations=false",
            r"model.sees_relations=false: \[init.model\] sees_relations is false; expected",
        ),
        (
            "model.width=wide",
            r"\[init.model\] width is 'wide'; expected a whole number\.",
        ),
        ("model.is_ordered=1", "is_ordered is 1; expected true or false"),
        (
            "model.prediction=x",
            "prediction is 'x'; expected 'preconditioned' or 'noise'",
        ),
        ("augmentation.jitter_wave_m=[1.0]", r"is \[1.0\]; expected two numbers"),
        (
            "augmentation.warp_share=2",
            r"\[init.augmentation\] warp_share is 2.0; expected 0 to 1",
        ),
        ("optimisation.ema_decay=1.5", "ema_decay is 1.5; expected at least 0"),
        ("width=96", r"--set width=96: expected SECTION\.FIELD=VALUE, such as"),
        ("model.width", "expected SECTION"),
        ("model.a.b=1", r"\[init.model\] has no field 'a'; expected one of width"),
    ],
)
def test_what_cannot_be_set_is_told_with_the_nearest_name(text: str, sentence: str):
    with pytest.raises(TrainingError, match=sentence) as caught:
        new_config(request(None, text), is_gpu=False)
    assert "\n" not in str(caught.value)


def test_the_message_names_the_files_that_set_the_section(tmp_path: Path):
    base, mine = tmp_path / "base.toml", tmp_path / "mine.toml"
    base.write_text("[model]\nwidth = 30\n[augmentation]\nwarp_share = 0.1\n")
    mine.write_text("[init.model]\nnum_heads = 4\n")
    given = settings_of([base, mine], (), "init")
    asked = RunRequest(stage="init", data=("/data",), settings=given)
    with pytest.raises(TrainingError) as caught:
        new_config(asked, is_gpu=False)
    assert str(caught.value).startswith(
        f"{base}, {mine}: [init.model] width is 30 and num_heads is 4; expected"
    )


def test_the_network_sees_no_more_neighbours_than_scenes_hold():
    def asked(number: int) -> RunRequest:
        given = settings_of((), (f"model.num_near_agents={number}",), "traj")
        return RunRequest(stage="traj", data=("/data",), settings=given)

    most = NUM_NEAR_AGENTS
    assert new_config(asked(most), is_gpu=False).model["num_near_agents"] == most
    told = f"num_near_agents is {most + 1}; scenes are prepared with the {most} nearest"
    with pytest.raises(TrainingError, match=told):
        new_config(asked(most + 1), is_gpu=False)


def test_files_that_are_no_settings_are_refused(tmp_path: Path):
    path = tmp_path / "bad.toml"
    for text, sentence in (
        ("model = [", "is no TOML"),
        ("model = 3", "model is no table of fields"),
        ("init = 3", "init is no table"),
        ("[speed]\nx = 1", "there is no section 'speed'"),
    ):
        path.write_text(text)
        with pytest.raises(TrainingError, match=sentence):
            settings_of([path], (), "init")
    with pytest.raises(TrainingError, match="No such file"):
        settings_of([tmp_path / "absent.toml"], (), "init")


def test_a_config_that_is_given_nothing_is_the_same():
    assert with_settings(Optimisation(), {}, "optimisation") == Optimisation()


@pytest.mark.parametrize("path", sorted((ROOT / "examples/variants").glob("*.toml")))
@pytest.mark.parametrize("stage", ["init", "traj"])
def test_the_variants_of_the_documents_are_the_default_but_for_their_fields(
    path: Path, stage: StageName
):
    def config(*files: Path) -> RunConfig:
        given = settings_of(files, (), stage)
        asked = RunRequest(stage=stage, data=("/data",), settings=given)
        return new_config(asked, is_gpu=False)

    plain, variant = config(), config(path)
    given = settings_of([path], (), stage)
    assert (variant != plain) == bool(given.values)
    for section in ("model", "loss", "augmentation"):
        changed = {
            name: value
            for name, value in getattr(variant, section).items()
            if getattr(plain, section)[name] != value
        }
        assert changed == given.of(section)
