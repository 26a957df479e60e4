"""The study of variants trains what is left of equal networks, and joins their stages."""

import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from pd_editor.base.errors import TrainingError
from pd_editor.experiments.training.settings import (
    RunRequest,
    StageName,
    new_config,
    settings_of,
)
from reproduction import variants
from reproduction.variants import BASE, VARIANTS, Study, run_study, stages_of, tasks_of


def test_each_variant_trains_the_stages_that_it_changes(tmp_path: Path):
    own = tmp_path / "mine.toml"
    own.write_text("[model]\nwidth = 32\n")
    assert stages_of(own) == ("init", "traj")
    found = {
        (one.variant, one.stage): one.files
        for one in tasks_of(Study(variants=(*VARIANTS, own)), 0)
    }
    assert found["pd", "init"] == found["pd", "traj"] == (BASE,)
    assert found["mine", "traj"] == (BASE, own)
    of_stage = {
        stage: {name for name, other in found if other == stage}
        for stage in ("init", "traj")
    }
    assert of_stage["init"] == {"pd", "mha", "pd_minus_cdb", "paper", "mine"}
    assert of_stage["traj"] == {
        "pd",
        "pd_minus_p",
        "vd",
        "paper",
        "pd_with_warps",
        "mine",
    }


def begin(run: Path, stage: StageName, *files: Path) -> None:
    """A run's folder as a training leaves it, but for its weights."""
    given = settings_of(files, (), stage)
    asked = RunRequest(stage=stage, data=("/data",), settings=given)
    run.mkdir(parents=True)
    (run / "run.json").write_text(new_config(asked, is_gpu=False).to_json())


def test_a_variant_that_was_edited_since_its_training_is_refused(tmp_path: Path):
    """Whether a field has another value, is new, or has been taken out of the file."""
    file, run = (
        tmp_path / "mine.toml",
        tmp_path / "out" / "mine-seed0" / "runs" / "traj",
    )
    study = Study(out=tmp_path / "out", data=tmp_path, seeds=(0,), variants=(file,))
    file.write_text("[traj.model]\nnum_blocks = 1\n[traj.loss]\nmetre_share = 0.25\n")
    begin(run, "traj", BASE, file)
    variants.check(study, list(tasks_of(study, 0)))
    for text, told in (
        (
            "num_blocks = 3\n[traj.loss]\nmetre_share = 0.25",
            "num_blocks was 1, is now 3",
        ),
        ("num_blocks = 1", "loss.metre_share was 0.25, is now 0.5"),
        (
            "num_blocks = 1\n[traj.loss]\nmetre_share = 0.25\n[traj.sampler]\nnum_steps = 4",
            "sampler.num_steps was None, is now 4",
        ),
    ):
        file.write_text(f"[traj.model]\n{text}\n")
        with pytest.raises(TrainingError, match=told) as caught:
            run_study(study)
        assert f"mine.toml: {run} was begun" in str(caught.value)
        assert "delete that folder" in str(caught.value)


def test_a_variant_that_cannot_be_trained_is_refused_before_any_is(tmp_path: Path):
    file, same = tmp_path / "mine.toml", tmp_path / "pd.toml"
    file.write_text("[traj.model]\nnum_block = 1\n")
    same.write_text("[model]\nwidth = 32\n")
    for path, told in ((file, "the nearest is num_blocks"), (same, "several variants")):
        study = Study(out=tmp_path / "out", data=tmp_path, variants=(path,))
        with pytest.raises(TrainingError, match=told):
            run_study(study)
        assert not study.out.exists()


def test_what_is_trained_is_not_trained_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    calls: list[tuple[str, str, dict]] = []
    joined: list[tuple[str, str, str]] = []
    stop_at = "vd"

    def train(stage: StageName, **options):
        variant = options["out"].parents[1].name
        calls.append((variant, stage, options))
        is_stopped = variant.startswith(stop_at)
        folder = options["out"]
        (folder / "model").mkdir(parents=True, exist_ok=True)
        asked = RunRequest(
            stage=stage,
            data=("/data",),
            settings=settings_of(options["config"], (), stage),
        )
        config = new_config(asked, is_gpu=False)
        (folder / "run.json").write_text(config.to_json())
        steps = 0 if is_stopped else options["steps"]
        about = {"stages": {stage: {"training": {"steps": steps}}}}
        (folder / "model" / "config.json").write_text(json.dumps(about))
        return SimpleNamespace(is_stopped=is_stopped)

    monkeypatch.setattr(variants, "train", train)
    monkeypatch.setattr(
        variants,
        "model",
        lambda out, init, traj: joined.append(
            (out.name, init.parents[1].name, traj.parents[1].name)
        ),
    )
    study = Study(
        out=tmp_path / "out", data=tmp_path, seeds=(0, 1), only_train=True, init_steps=7
    )
    assert run_study(study) == 130
    assert not joined
    first = [(variant, stage) for variant, stage, _ in calls]
    assert first[-1] == ("vd-seed0", "traj")
    calls.clear()
    stop_at = "none"
    assert run_study(study) == 0
    again = [(variant, stage) for variant, stage, _ in calls]
    assert not set(first[:-1]) & set(again)
    assert again[0] == ("vd-seed0", "traj")
    assert calls[0][2]["resume"]
    assert not calls[1][2]["resume"]
    assert {options["steps"] for _, stage, options in calls if stage == "init"} == {7}
    assert {options["seed"] for _, _, options in calls} == {0, 1}
    assert "All variants are trained" in capsys.readouterr().out
    assert ("mha-seed1", "mha-seed1", "pd-seed1") in joined
    assert ("vd-seed0", "pd-seed0", "vd-seed0") in joined
    assert ("paper-seed0", "paper-seed0", "paper-seed0") in joined
