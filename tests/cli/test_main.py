import pytest

from pd_editor.cli import main as main_module
from tests.cli.shell import JUNCTION, Shell, run_in_process

COMMANDS = ("edit", "warp", "generate", "export", "replay", "evaluate", "synth")


def test_help_names_commands_and_demos(shell: Shell):
    result = shell.run("--help")
    assert (result.code, result.err) == (0, "")
    for name in (*COMMANDS, JUNCTION, "winding-street"):
        assert name in result.out


@pytest.mark.parametrize("command", COMMANDS)
def test_every_option_is_explained(shell: Shell, command: str):
    result = shell.run(command, "--help")
    assert (result.code, result.err) == (0, "")
    for leftover in ("None", "STR", "PATH", "Args:", "``"):
        assert leftover not in result.out


@pytest.mark.parametrize(
    "arguments",
    [
        "",
        "fly",
        "warp",
        "export --out x",
        f"export {JUNCTION}",
        f"export {JUNCTION} --out x --format mp3",
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
        "import pd_editor.scenario_store as store\n"
        "def broken(*_a, **_k):\n"
        "    raise ZeroDivisionError('a bug')\n"
        "store.open_scenario = broken\n"
    )
    env = {"PYTHONPATH": f"{tmp_path}:{main_module.__file__.rsplit('/', 3)[0]}"}
    done = run_in_process("export", JUNCTION, "--out", "x", cwd=tmp_path, env=env)
    assert (done.code, done.out) == (1, "")
    assert "ZeroDivisionError: a bug" in done.err
