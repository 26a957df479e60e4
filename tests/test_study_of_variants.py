"""The study of variants trains what is left of equal networks, and joins their stages."""

import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from benchmarks import variants
from benchmarks.variants import BASE, VARIANTS, Study, run_study, stages_of, tasks_of


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


def test_what_is_trained_is_not_trained_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    calls: list[tuple[str, str, dict]] = []
    joined: list[tuple[str, str, str]] = []
    stop_at = "vd"

    def train(stage: str, **options):
        variant = options["out"].parents[1].name
        calls.append((variant, stage, options))
        is_stopped = variant.startswith(stop_at)
        folder = options["out"]
        (folder / "model").mkdir(parents=True, exist_ok=True)
        (folder / "run.json").touch()
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
    assert ("mha-seed1", "mha-seed1", "pd-seed1") in joined
    assert ("vd-seed0", "pd-seed0", "vd-seed0") in joined
    assert ("paper-seed0", "paper-seed0", "paper-seed0") in joined
