import os
import subprocess
import sys

import pytest

from pd_editor.cli import main as main_module
from pd_editor.scene.formats.registry import formats
from tests.cli.shell import JUNCTION, ROOT, Shell, run_in_process

COMMANDS = (
    *("edit", "warp", "generate", "threats", "export", "convert", "render", "replay"),
    *("family", "drive", "evaluate", "study", "index", "find", "library"),
    *("synth", "train", "model", "doctor"),
)
ACTIONS = tuple(
    f"library {one}"
    for one in ("add", "list", "find", "tag", "metrics", "export", "check")
)


def test_help_names_commands_and_demos(shell: Shell):
    result = shell.run("--help")
    assert (result.code, result.err) == (0, "")
    for name in (*COMMANDS, JUNCTION, "winding-street"):
        assert name in result.out


@pytest.mark.parametrize("command", COMMANDS + ACTIONS)
def test_every_option_is_explained(shell: Shell, command: str):
    result = shell.run(*command.split(), "--help")
    assert (result.code, result.err) == (0, "")
    empty = ("(default: )", "(default: '')", "(default: ())")
    for leftover in ("None", "STR", "PATH", "Args:", "``", *empty, "--no-debug"):
        assert leftover not in result.out


@pytest.mark.parametrize("command", ["export", "convert", "library export"])
def test_the_formats_to_write_are_named(shell: Shell, command: str):
    """``convert`` named none of them, the others some."""
    words = " ".join(shell.run(*command.split(), "--help").out.split())
    words = words.replace("\u2502 ", "").replace("| ", "")
    known = ", ".join(one.name for one in formats().values() if one.write)
    assert f"Format to write: {known}, or one of your own." in words


def test_the_help_of_training_asks_for_no_validation_set(shell: Shell):
    """It said "(required)" of it, and "a part of the data unless given"."""
    lines = shell.run("train", "--help").out.splitlines()
    words = " ".join(" ".join(line.strip("\u2502 ") for line in lines).split())
    assert "a part of the data unless given. (optional)" in words


def test_the_version(shell: Shell):
    result = shell.run("--version")
    assert (result.code, result.err) == (0, "")
    assert result.out.startswith("pd-editor 0.")


@pytest.mark.parametrize(
    "arguments",
    [
        "",
        "fly",
        "warp",
        "export --out x",
        f"export {JUNCTION}",
        f"warp {JUNCTION} --out x --kind smooth --power 2",
        f"warp {JUNCTION} --out x --kind smooth-turn --power two",
        f"generate {JUNCTION} --out x --seed 1.5",
        f"generate {JUNCTION} --out x --sed 1",
    ],
)
def test_wrong_arguments_exit_with_2(shell: Shell, arguments: str):
    result = shell.run(*arguments.split())
    assert (result.code, result.out) == (2, "")
    assert "--help" in result.err
    assert "Traceback" not in result.err


def test_an_interruption_exits_with_130(shell: Shell, monkeypatch: pytest.MonkeyPatch):
    def interrupted(*_arguments: object, **_options: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(
        main_module.tyro.extras, "subcommand_cli_from_dict", interrupted
    )
    result = shell.run("export", JUNCTION)
    assert (result.code, result.out) == (130, "")
    assert result.err == "pd-editor: Interrupted.\n"


def test_a_process_of_its_own(tmp_path):
    done = run_in_process("export", JUNCTION, "--out", "here", cwd=tmp_path)
    assert (done.code, done.out, done.err) == (0, f"here/{JUNCTION}\n", "")
    again = run_in_process("export", JUNCTION, "--out", "here", cwd=tmp_path)
    assert (again.code, again.out) == (2, "")
    assert again.err.startswith("pd-editor: ")
    assert again.err.count("\n") == 1


def test_a_bug_exits_with_1_and_a_traceback(tmp_path):
    (tmp_path / "sitecustomize.py").write_text(
        "import pd_editor.editor.scenario_store as store\n"
        "def broken(*_a, **_k):\n"
        "    raise ZeroDivisionError('a bug')\n"
        "store.open_scenario = broken\n"
    )
    env = {"PYTHONPATH": f"{tmp_path}:{main_module.__file__.rsplit('/', 3)[0]}"}
    done = run_in_process("export", JUNCTION, "--out", "x", cwd=tmp_path, env=env)
    assert (done.code, done.out) == (1, "")
    assert "ZeroDivisionError: a bug" in done.err


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ("warp", "Missing --kind, --power, --out; see pd-editor warp --help"),
        (
            "generate x --seed y --out o",
            "--seed: 'y' is not a whole number; see pd-editor generate --help",
        ),
        (
            "generate x --sed 3 --out o",
            "There is no --sed; the nearest is --seed; see pd-editor generate --help",
        ),
        # What is missing is told when what there is can be read.
        ("generate x --resample", "There is no --resample; the nearest is --resample-"),
        ("library find x y --jsn", "There is no --jsn; the nearest is --json; see "),
        ("generate x --bogus", "Missing --out; see pd-editor generate --help"),
        (
            "generate x --bogus --out o",
            "Unknown arguments: --bogus; see pd-editor generate --help",
        ),
        ("bogus", "There is no command 'bogus'; choose among edit, warp, generate, "),
        ("--bogus", "Unknown arguments: --bogus; see pd-editor --help"),
        ("export x --out", "--out lacks its value; see pd-editor export --help"),
        ("export x\0 --out o", r"x\x00: is no usable path"),
        ("export x\ud800 --out o", r"x\ud800: is no usable path"),
        ("train init --data x\0", r"x\x00: is no usable path"),
        ("train init --data . --validate x\ud800", r"x\ud800: is no usable path"),
        ("train init --data . --from x\0", r"x\x00: is no usable path"),
        ("evaluate --out o --data x\ud800", r"x\ud800"),
        ("synth --out o --num 1 --maps x\ud800", r"x\ud800"),
        ("generate roundabout --out o --model x\ud800", r"x\ud800"),
        ("model --init x\ud800 --traj x --out o", r"x\ud800"),
        ("replay /dev/zero --out o", "/dev/zero: is not a regular file"),
        (f"synth --out o --num {10**21}", f"--num is {10**21}; expected 1 to 1000000"),
        (f"train init --devices {10**21}", f"--devices is {10**21}; expected 1 to 64"),
        (f"train traj --threads {10**21}", f"--threads is {10**21}; expected 1 to"),
        (f"evaluate --data x --out o --samples {10**21}", "expected 1 to 1000"),
        (f"evaluate --data x --out o --workers {10**21}", "expected 1 to 256"),
        (f"synth --out o --num {'9' * 5000}", "the number has too many digits"),
    ],
)
def test_a_wrong_argument_is_one_sentence(shell, arguments, sentence):
    """No boxes of many lines, no numbers without limits (faults 2, 5, 7, 10)."""
    assert sentence in shell.refused(*arguments.split(" "))


def test_a_wrong_choice_is_told_the_right_ones(shell: Shell):
    """They stood in brackets and quotes, as Python prints them."""
    words = ["warp", "x", "--out", "o", "--kind", "bend", "--power", "1"]
    told = shell.refused(*words).replace(",", "").replace(";", "").split()
    assert {"double-turn", "smooth-turn", "ripple-road"} < set(told)


SHELL_LINES = {
    "head": "{pd} export {demo} --out {out} | true; echo ${{PIPESTATUS[0]}}",
    "help": "{pd} --help | true; echo ${{PIPESTATUS[0]}}",
    "version": "{pd} --version | true; echo ${{PIPESTATUS[0]}}",
    "closed": "{pd} export {demo} --out {out} >&-; echo $?",
    "no-stderr": "{pd} export nowhere --out {out} 2>/dev/full; echo $?",
    "full": "{pd} export {demo} --out {out} >/dev/full; echo $?",
    "help-full": "{pd} warp --help >/dev/full; echo $?",
    "both-full": "{pd} --version >/dev/full 2>&1; echo $?",
}
EXPECTED_CODES = {"no-stderr": 2, "full": 2, "help-full": 2, "both-full": 2}


@pytest.mark.parametrize("name", SHELL_LINES)
def test_an_output_without_reader_or_room_is_no_bug(tmp_path, name: str):
    """The files were written, and a traceback and exit code 1 said that there is a bug."""
    line = SHELL_LINES[name].format(
        pd=f"{sys.executable} -m pd_editor", demo=JUNCTION, out=tmp_path / "out"
    )
    done = subprocess.run(
        ["bash", "-c", line],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        cwd=ROOT,
    )
    assert "Traceback" not in done.stderr, done.stderr
    assert "Exception ignored" not in done.stderr, done.stderr
    assert int(done.stdout.splitlines()[-1]) == EXPECTED_CODES.get(name, 0)
    if name in ("full", "help-full"):
        assert done.stderr == (
            "pd-editor: The output cannot be written (No space left on device).\n"
        )
    assert (tmp_path / "out" / JUNCTION).exists() is (
        name in ("head", "closed", "full")
    )


PATH_OPTIONS = (
    "export {} --out o",
    f"export {JUNCTION} --out {{}}",
    f"export {JUNCTION} --zip --out {{}}",
    f"warp {JUNCTION} --kind smooth-turn --power 2 --out {{}}",
    f"generate {JUNCTION} --model {{}} --out o",
    f"generate {JUNCTION} --model lane-follower --out {{}}",
    "replay {} --out o",
    "evaluate --data {} --methods constant-velocity --out o",
    "evaluate --data demos --methods {} --out o",
    "study --data {} --methods constant-velocity --out o",
    "model --init {} --out o",
    "model --traj {} --out o",
    "train init --data {} --out o",
    "synth --maps {} --num 1 --out o",
    "synth --networks {} --num 1 --out o",
    "edit --models {}",
    "edit --data {}",
)


@pytest.fixture(scope="module")
def odd_paths(tmp_path_factory):
    """Paths that raise when pathlib asks for them."""
    folder = tmp_path_factory.mktemp("odd")
    (folder / "loop").symlink_to("loop")
    (folder / "closed" / "inside").mkdir(parents=True)
    (folder / "file").write_text("")
    (folder / "closed").chmod(0)
    yield {
        "long name": "x" * 5000,
        "long path": "/".join(["x" * 200] * 40),
        "loop": folder / "loop",
        "in a loop": folder / "loop" / "x",
        "in a file": folder / "file" / "x",
        "closed": folder / "closed" / "inside",
        "no user": "~nosuchuser/x",
    }
    (folder / "closed").chmod(0o700)


@pytest.mark.parametrize("line", PATH_OPTIONS)
def test_no_path_is_a_bug(shell: Shell, odd_paths, tmp_path, monkeypatch, line: str):
    monkeypatch.chdir(tmp_path)
    for what, path in odd_paths.items():
        if what == "no user" and not line.startswith(("export {}", "edit")):
            continue  # A relative folder of this name can be made.
        if what == "closed" and os.geteuid() == 0:
            continue  # Root may enter it.
        words = [str(path) if one == "{}" else one for one in line.split()]
        result = shell.run(*words)
        assert result.code == 2, (what, result)
        assert result.err.count("\n") == 1, (what, result.err)


def test_a_home_folder_after_an_equals_sign_is_that_of_the_user(
    shell: Shell, tmp_path, monkeypatch
):
    """Shells expand it in front of a word only; a folder named ~ was made."""
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.chdir(tmp_path)
    shell.run("export", "roundabout", "--out=~/made")
    assert (tmp_path / "home" / "made" / "roundabout").is_dir()
    assert not (tmp_path / "~").exists()
