import copy
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
import torch

import pd_editor
from pd_editor.base.errors import ModelError
from pd_editor.base.installed_files import models_folder
from pd_editor.experiments.recordings.clip_selection import choose_windows
from pd_editor.experiments.recordings.shards import shard_bytes
from pd_editor.experiments.training.settings import StageName
from pd_editor.generation.checkpoints.model_folder import load_model, save_model
from pd_editor.generation.checkpoints.tensor_file import read_tensors, write_tensors
from pd_editor.generation.generators import SHIPPED_MODEL
from pd_editor.generation.initial_state.network.denoiser import InitialStateDenoiser
from pd_editor.generation.stages import STAGE_KINDS
from tests.cli.shell import ROOT, Result, Shell, run_in_process
from tests.experiments.recordings.recordings import drive

pytestmark = pytest.mark.usefixtures("no_processes")

FILES = {"data.json", "log.jsonl", "loss.png", "model", "run.json", "state.safetensors"}
TINY = ("--preset", "tiny", "--device", "cpu", "--threads", "1", "--precision", "32")


@pytest.fixture(scope="module")
def shards(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Shards of three recordings."""
    folder = tmp_path_factory.mktemp("corpus")
    for number in range(3):
        recording = drive(name=f"drive-{number}", seed=number)
        windows = choose_windows(recording, seed=3, num_windows=6)
        (folder / f"drive-{number}.shard").write_bytes(
            shard_bytes([(recording, windows)])
        )
    return folder


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="module")
def runs(shards: Path, cache: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run of each stage."""
    folder = tmp_path_factory.mktemp("runs")
    stages: tuple[StageName, ...] = ("init", "traj")
    for stage in stages:
        pd_editor.train(
            stage,
            data=shards,
            out=folder / stage,
            cache=cache,
            preset="tiny",
            steps=6,
            device="cpu",
            precision="32",
        )
    return folder


@pytest.mark.parametrize("stage", ["init", "traj"])
def test_a_run_leaves_a_model(runs: Path, stage: str):
    assert {one.name for one in (runs / stage).iterdir()} == FILES
    model = load_model(runs / stage / "model", STAGE_KINDS)
    assert list(model.stages) == [stage]
    assert model.stages[stage].about["steps"] == 6
    lines = (runs / stage / "log.jsonl").read_text().splitlines()
    log = [json.loads(line) for line in lines]
    assert log[-1]["step"] == 6
    assert (runs / stage / "loss.png").read_bytes()[:4] == b"\x89PNG"


def test_the_shell_says_what_came_out(
    shell: Shell, shards: Path, cache: Path, tmp_path: Path
):
    out = tmp_path / "run"
    options = ("--data", shards, "--out", out, "--cache", cache, *TINY)
    result = shell.run("train", "traj", *options, "--steps", 3)
    assert (result.code, result.err) == (0, "")
    assert result.lines[0] == str(out / "model")
    assert result.lines[1].startswith("3 steps in ")
    assert "already holds files" in shell.refused("train", "traj", *options)
    longer = shell.run("train", "traj", "--out", out, "--resume", "--steps", 5,
                       "--cache", cache, "--device", "cpu")  # fmt: skip
    assert longer.code == 0, longer.err
    assert longer.lines[1].startswith("5 steps in ")
    seeded = ("--resume", "--out", out, "--seed", 4, "--cache", cache)
    assert "seed" in shell.refused("train", "traj", *seeded)
    assert "stage" in shell.refused("train", "init", "--resume", "--out", out)


def test_a_run_that_was_killed_before_its_model_is_resumed(
    runs: Path, cache: Path, tmp_path: Path
):
    """Killed between the last state and the model, it could never be gone on with."""
    run = tmp_path / "run"
    shutil.copytree(runs / "init", run)
    shutil.rmtree(run / "model")
    found = pd_editor.train("init", out=run, resume=True, cache=cache, device="cpu")
    assert found.steps == 6
    ours, theirs = run / "model", runs / "init" / "model"
    assert {one.name for one in ours.iterdir()} == {
        one.name for one in theirs.iterdir()
    }
    (weights,) = ours.glob("*.safetensors")
    assert weights.read_bytes() == (theirs / weights.name).read_bytes()


def test_a_finished_run_can_be_given_more_time(runs: Path, cache: Path, tmp_path: Path):
    shutil.copytree(runs / "traj", tmp_path / "run")
    found = pd_editor.train(
        "traj", out=tmp_path / "run", resume=True, cache=cache, device="cpu", steps=9
    )
    assert found.steps == 9
    again = pd_editor.train(
        "traj", out=tmp_path / "run", resume=True, cache=cache, device="cpu"
    )
    assert again.steps == 9


def test_a_run_of_before_statistics_were_measured_goes_on(
    runs: Path, cache: Path, tmp_path: Path
):
    run = shutil.copytree(runs / "init", tmp_path / "run")
    state = read_tensors(run / "state.safetensors", "training-state")
    kept = {
        name: one
        for name, one in state.tensors.items()
        if not name.endswith(("state_moments", "clean_variance"))
    }
    assert len(kept) == len(state.tensors) - 4
    write_tensors(run / "state.safetensors", "training-state", kept, state.about)
    found = pd_editor.train(
        "init", out=run, resume=True, cache=cache, device="cpu", steps=8
    )
    assert found.steps == 8


def test_stages_are_joined_in_half_precision(shell: Shell, runs: Path, tmp_path: Path):
    out = tmp_path / "models" / "mine"
    joined = shell.run(
        "model", "--out", out, "--init", runs / "init", "--traj", runs / "traj"
    )
    assert joined.code == 0, joined.err
    assert {one.name for one in out.iterdir()} == {
        "MODEL_CARD.md",
        "config.json",
        "initial_states.safetensors",
        "initial_states_loss.png",
        "trajectories.safetensors",
        "trajectories_loss.png",
    }
    model = load_model(out, STAGE_KINDS)
    assert set(model.stages) == {"init", "traj"}
    weights = (runs / "traj" / "model" / "trajectories.safetensors").stat().st_size
    assert (out / "trajectories.safetensors").stat().st_size < 0.8 * weights
    assert "| traj |" in (out / "MODEL_CARD.md").read_text()
    again = pd_editor.model(out=out, traj=runs / "traj")
    assert load_model(again.folder, STAGE_KINDS).sha256 == model.sha256


def test_the_card_of_a_model_follows_its_weights(runs: Path, tmp_path: Path):
    """It went on telling steps and losses of the first stages that were joined."""
    out = tmp_path / "mine"
    card = pd_editor.model(out=out, init=runs / "init").folder / "MODEL_CARD.md"
    assert "| traj |" not in card.read_text()
    pd_editor.model(out=out, traj=runs / "traj")
    assert "| traj |" in card.read_text()
    card.write_text("By hand.")
    pd_editor.model(out=out, traj=runs / "traj")
    assert card.read_text() == "By hand."
    (tmp_path / "file").write_text("")
    with pytest.raises(ModelError, match="cannot be written"):
        pd_editor.model(out=tmp_path / "file" / "x", traj=runs / "traj")


def test_weights_of_several_trainings_are_averaged(
    shell: Shell, runs: Path, cache: Path, tmp_path: Path
):
    longer = shutil.copytree(runs / "traj", tmp_path / "longer")
    pd_editor.train("traj", out=longer, resume=True, cache=cache, device="cpu", steps=9)
    out = tmp_path / "average"
    done = shell.run("model", "--out", out, "--traj", runs / "traj", longer)
    assert done.code == 0, done.err
    one, other, average = (
        load_model(folder, STAGE_KINDS).stage("traj")
        for folder in (runs / "traj" / "model", longer / "model", out)
    )
    weights = dict(one.model.named_parameters())
    for name, found in average.model.state_dict().items():
        first, second = one.model.state_dict()[name], other.model.state_dict()[name]
        if name in weights:
            torch.testing.assert_close(
                found, (first + second) / 2, rtol=2e-3, atol=1e-4
            )
        else:
            assert torch.equal(found, first)
    assert average.about["averaged_with"][0]["steps"] == 9
    shipped = models_folder() / SHIPPED_MODEL
    told = shell.refused("model", "--out", tmp_path / "no", "--traj", longer, shipped)
    assert "differs" in told
    other = shutil.copytree(runs / "traj", tmp_path / "other")
    config = other / "model" / "config.json"
    config.write_text(config.read_text().replace('"seed": 0', '"seed": 7'))
    told = shell.refused("model", "--out", tmp_path / "no", "--traj", longer, other)
    assert "began with the random weights of seed 7" in told
    assert not (tmp_path / "no").exists()


def test_what_the_sampler_needs_is_measured_again_on_data(
    shell: Shell,
    runs: Path,
    shards: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
):
    """For weights of before it was measured; a training has done so."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    names = ("state_moments", "clean_variance")
    trained = load_model(runs / "init" / "model", STAGE_KINDS).stage("init")
    unmeasured = InitialStateDenoiser(trained.config).state_dict()
    for name in names:
        assert not torch.equal(trained.model.get_buffer(name), unmeasured[name])
    earlier = copy.deepcopy(trained.model)
    for name in names:
        earlier.get_buffer(name).copy_(unmeasured[name])
    save_model(tmp_path / "earlier", {"init": replace(trained, model=earlier)})
    out = tmp_path / "measured"
    options = ("--init", tmp_path / "earlier", "--measure", shards)
    done = shell.run("model", "--out", out, *options)
    assert done.code == 0, done.err
    found = load_model(out, STAGE_KINDS).stage("init").model
    for name in names:
        wanted = trained.model.get_buffer(name)
        torch.testing.assert_close(found.get_buffer(name), wanted, rtol=0.05, atol=0.01)
    options = ("--traj", runs / "traj", "--measure", shards)
    told = shell.refused("model", "--out", tmp_path / "none", *options)
    assert "no initial states to measure" in told


def test_what_is_no_trained_stage_is_refused(shell: Shell, runs: Path, tmp_path: Path):
    assert "--init" in shell.refused("model", "--out", tmp_path / "a")
    swapped = ("--init", runs / "traj")
    assert "no weights" in shell.refused("model", "--out", tmp_path / "b", *swapped)
    missing = ("--traj", tmp_path / "none")
    assert "no model" in shell.refused("model", "--out", tmp_path / "c", *missing)


def test_bad_input_is_said_in_a_sentence(
    shell: Shell, shards: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def refused(*options: object) -> str:
        return shell.refused("train", "traj", "--out", tmp_path / "run", *options)

    empty = tmp_path / "empty"
    empty.mkdir()
    cache = ("--cache", tmp_path / "cache", "--device", "cpu")
    assert "--data" in refused()
    assert "none" in refused("--data", tmp_path / "none", *cache)
    assert "neither" in refused("--data", empty, *cache)
    assert "GPU" in refused("--data", shards, "--device", "cuda")
    assert "weights" in refused("--data", shards, "--weights", 1, 2)
    assert "minutes" in refused("--data", shards, "--minutes", 0)
    assert "--threads" in refused("--data", shards, "--threads", 0)
    assert "no training run" in refused("--resume")
    watched = ("--data", shards, *cache, "--evaluate-every", 1)
    assert "needs --validate" in refused(*watched)
    assert "scenario folders" in refused(*watched, "--validate", shards)
    monkeypatch.setitem(sys.modules, "tensorboard", None)
    told = refused("--data", shards, *cache, "--tensorboard")
    assert "pip install 'pd-editor[monitor]'" in told
    assert not (tmp_path / "run").exists()


def test_both_stages_are_checked_before_the_first_is_trained(
    shell: Shell, shards: Path, tmp_path: Path
):
    file = tmp_path / "mine.toml"
    file.write_text("[traj.model]\nwidth = 30\n")
    out = tmp_path / "out"
    data = ("--data", shards, "--cache", tmp_path / "cache", "--steps", 1)
    told = shell.refused("train", "all", "--out", out, *data, *TINY, "--config", file)
    assert f"{file}: [traj.model] width is 30 and num_heads is 4" in told
    assert not out.exists()
    (out / "runs" / "traj").mkdir(parents=True)
    (out / "runs" / "traj" / "notes.txt").touch()
    told = shell.refused("train", "all", "--out", out, *data, *TINY)
    assert "already holds files" in told
    assert not (out / "runs" / "init").exists()


def test_the_fields_of_both_stages_are_listed(shell: Shell):
    listed = shell.run("train", "all", "--fields")
    assert listed.code == 0, listed.err
    for name in ("init.model.num_layers", "traj.augmentation.warp_share"):
        assert f"| `{name}` |" in listed.out


def test_broken_scenarios_are_counted(av2_scenario_folders: list[Path], tmp_path: Path):
    root = tmp_path / "av2"
    chosen = [one for one in av2_scenario_folders if one.parent.name == "train"][:7]
    for source in chosen:
        shutil.copytree(source, root / source.name)
    next((root / chosen[2].name).glob("*.json")).write_text("{}")
    found = pd_editor.train(
        "init", data=root, out=tmp_path / "run", cache=tmp_path / "cache",
        preset="tiny", steps=2, device="cpu", precision="32",
    )  # fmt: skip
    assert (found.num_scenes, found.num_left_out) == (6, 1)
    assert "1 scenarios or files were left out." in str(found)


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="signals")
def test_ctrl_c_leaves_a_run_that_goes_on(shards: Path, cache: Path, tmp_path: Path):
    out = tmp_path / "run"
    command = [sys.executable, "-m", "pd_editor", "train", "traj", *TINY]
    options = ["--data", shards, "--out", out, "--cache", cache, "--minutes", "30"]
    with subprocess.Popen(
        [*command, *map(str, options)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        waited = time.monotonic()
        while not (out / "log.jsonl").exists() and process.poll() is None:
            assert time.monotonic() - waited < 100
            time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        said, errors = process.communicate(timeout=100)
    # As of all commands: what follows && would take a half-trained model.
    assert process.returncode == 130, errors
    assert "Stopped; go on with --resume" in said
    assert "nan" not in said
    step = json.loads((out / "log.jsonl").read_text().splitlines()[-1])["step"]
    found = pd_editor.train(
        "traj", out=out, cache=cache, resume=True, steps=step + 2, device="cpu"
    )
    assert (found.steps, found.is_stopped) == (step + 2, False)


@pytest.mark.slow
@pytest.mark.parametrize("stage", ["init", "traj"])
def test_a_run_starts_from_a_model_and_keeps_its_basis(
    stage: StageName, runs: Path, shards: Path, cache: Path, tmp_path: Path
):
    """The weights begin where the model's are; each scenario is prepared twice."""
    source = runs / stage
    options = {"data": shards, "cache": cache, "preset": "tiny", "device": "cpu"}
    out = pd_editor.train(
        stage,
        out=tmp_path / "run",
        steps=1,
        precision="32",
        learning_rate=1e-7,
        start=source,
        copies=2,
        **options,
    )
    before = load_model(source / "model", STAGE_KINDS).stage(stage)
    after = load_model(out.model, STAGE_KINDS).stage(stage)
    assert after.about["start"] == stage
    # The weights of the start have seen warped roads, whatever this training sees.
    assert after.about["saw_warps"]
    assert after.about["scenes"] == 2 * before.about["scenes"]
    parameters = dict(after.model.named_parameters())
    for name, old in before.model.named_parameters():
        assert (parameters[name] - old).abs().max() < 1e-4, name
    for name, old in before.model.named_buffers():
        if name.startswith("decoder."):
            assert (dict(after.model.named_buffers())[name] == old).all(), name
    resumed = pd_editor.train(
        stage, out=tmp_path / "run", steps=2, resume=True, cache=cache
    )
    assert resumed.steps == 2


@pytest.mark.slow
def test_one_command_makes_a_model_of_ones_own_recordings(
    runs: Path, cache: Path, tmp_path: Path, av2_scenario_folders: list[Path]
):
    """Several windows of each scenario, another root to validate on, licence told."""
    roots = [tmp_path / "train", tmp_path / "val"]
    for root, folders in zip(
        roots, (av2_scenario_folders[:5], av2_scenario_folders[5:7]), strict=True
    ):
        for folder in folders:
            shutil.copytree(folder, root / folder.name)
    options = {"cache": cache, "preset": "tiny", "device": "cpu", "precision": "32"}
    start = pd_editor.model(
        out=tmp_path / "start", init=runs / "init", traj=runs / "traj"
    )
    out = pd_editor.train(
        "all",
        data=roots[0],
        validate=roots[1],
        start=start.folder,
        windows=3,
        steps=2,
        out=tmp_path / "own",
        **options,
    )
    assert out.num_scenes == 15
    assert out.steps == 4
    assert out.model == tmp_path / "own"
    stages = load_model(out.model, STAGE_KINDS).stages
    assert set(stages) == {"init", "traj"}
    for stage in stages.values():
        assert stage.about["validate"] == ["val"]
        assert stage.about["held_out_loss"] is not None
        assert len(stage.about["commit"]) >= 40
    # Squares of the simulation are denser than recorded ones.
    starting = load_model(start.folder, STAGE_KINDS).stage("init")
    assert starting.sampling["sampler"].fit_density == 0.72
    assert stages["init"].sampling["sampler"].fit_density == 1.0
    assert "CC BY-NC-SA" in (out.model / "MODEL_CARD.md").read_text()
    resumed = pd_editor.train(
        "all", out=tmp_path / "own", steps=3, resume=True, cache=cache
    )
    assert resumed.steps == 6


@pytest.mark.slow
def test_both_stages_are_trained_by_several_processes(shards: Path, tmp_path: Path):
    """With gloo on a CPU, as with NCCL on GPUs; the other processes say nothing."""
    out, empty = tmp_path / "own", tmp_path / "empty"
    empty.mkdir()

    def run(*options: object) -> Result:
        command = ("train", "all", "--devices", "2", "--device", "cpu",
                   "--threads", "1", "--cache", tmp_path / "cache")  # fmt: skip
        return run_in_process(*map(str, (*command, *options)))

    begin = ("--preset", "tiny", "--precision", 32, "--steps", 3)
    result = run("--data", shards, "--out", out, *begin)
    assert result.code == 0, result.err
    assert result.lines[0] == str(out)
    assert result.lines[1].startswith("6 steps in ")
    assert set(load_model(out, STAGE_KINDS).stages) == {"init", "traj"}
    longer = run("--out", out, "--resume", "--steps", 5)
    assert longer.code == 0, longer.err
    for stage in ("init", "traj"):
        lines = (out / "runs" / stage / "log.jsonl").read_text().splitlines()
        assert [json.loads(one)["step"] for one in lines] == [3, 5]
    refused = run("--data", empty, "--out", tmp_path / "new", *begin)
    assert (refused.code, refused.out) == (2, "")
    assert refused.err.count("\n") == 1, refused.err


@pytest.mark.slow
def test_processes_leave_their_group_before_the_interpreter_ends(tmp_path: Path):
    """Threads of a group that outlive the interpreter abort a process now and then."""
    script = tmp_path / "two_processes.py"
    script.write_text(
        "import atexit, sys\n"
        "import torch\n"
        "from pd_editor.cli.main import main\n"
        "def tell():\n"
        "    sys.stderr.write(f'is in a group: {torch.distributed.is_initialized()}\\n')\n"
        "atexit.register(tell)\n"
        "sys.exit(main())\n"
    )
    (tmp_path / "empty").mkdir()
    done = subprocess.run(
        [sys.executable, script, "train", "init", "--devices", "2", "--device", "cpu",
         "--threads", "1", "--preset", "tiny", "--cache", tmp_path / "cache",
         "--data", tmp_path / "empty", "--out", tmp_path / "run"],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )  # fmt: skip
    assert done.returncode == 2, done.stderr
    ends = [line for line in done.stderr.splitlines() if line.startswith("is in")]
    assert ends == ["is in a group: False"] * 2, done.stderr


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_samples_of_both_stages_are_evaluated_during_a_training(
    shards: Path, cache: Path, tmp_path: Path, av2_scenario_folders: list[Path]
):
    root = tmp_path / "val"
    for folder in [one for one in av2_scenario_folders if one.parent.name == "val"][:2]:
        shutil.copytree(folder, root / folder.name)
    watched = pd_editor.train(
        "all", data=shards, validate=root, cache=cache, preset="tiny", device="cpu",
        precision="32", steps=3, out=tmp_path / "own", evaluate_every=30.0,
        tensorboard=True,
    )  # fmt: skip
    for stage, name in (("init", "scene_test"), ("traj", "min_ade")):
        run = watched.folder / "runs" / stage
        lines = (run / "log.jsonl").read_text().splitlines()
        entry = next(one for one in map(json.loads, lines) if "samples" in one)
        assert entry["step"] == 3
        assert entry["samples"]["failed_scenes"] == 0
        assert entry["samples"][name] > 0
        assert list((run / "tensorboard").iterdir())


def test_a_variant_is_one_file_and_its_fields_are_stored_with_the_weights(
    shell: Shell, shards: Path, cache: Path, tmp_path: Path
):
    variant = tmp_path / "without-warps.toml"
    variant.write_text(
        "[augmentation]\nwarp_share = 0.0\n[model]\nis_ordered = false\n"
    )
    command = (
        "train", "init", "--data", shards, "--cache", cache, "--preset", "tiny",
        "--steps", 1, "--device", "cpu", "--precision", "32", "--out", tmp_path / "run",
    )  # fmt: skip
    told = shell.refused(*command, "--config", variant, "--set", "model.widht=16")
    assert told.endswith(
        "model.widht=16: [init.model] has no field 'widht'; the nearest is width."
    )
    result = shell.run(*command, "--config", variant, "--set", "model.width=16")
    assert result.code == 0, result.err
    config = json.loads((tmp_path / "run" / "model" / "config.json").read_text())
    stage = config["stages"]["init"]
    assert (stage["config"]["width"], stage["config"]["is_ordered"]) == (16, False)
    assert stage["training"]["augmentation"]["warp_share"] == 0.0
