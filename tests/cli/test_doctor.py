"""The doctor: a machine that is in order, and one on which much is wrong."""

import socket
from importlib import metadata
from pathlib import Path

import pytest

import pd_editor
from pd_editor.cli.main import main


def test_a_machine_in_order_has_a_line_per_check(capsys: pytest.CaptureFixture[str]):
    assert main(["doctor"]) == 0
    out, err = capsys.readouterr()
    assert not err
    told = dict(line.split(maxsplit=1) for line in out.splitlines())
    assert told["packages"] == f"all of pd-editor {metadata.version('pd-editor')}"
    assert told.keys() >= {"Python", "extras", "device", "disk", "port", "browser"}
    assert "agents and written" in told["traffic"]
    assert ", 1 threads" not in told["device"]


def test_each_fault_is_a_sentence_and_the_rest_is_looked_at(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
):
    wanted = [
        "numpy>=99",
        "no-such-package>=1",
        'ray>=99; extra == "cluster"',
        'numpy>=1; extra == "gym"',
    ]
    monkeypatch.setattr(metadata, "requires", lambda _: wanted)
    monkeypatch.setattr(pd_editor.cli.doctor, "demo_names", lambda: ("no-such-demo",))
    file = tmp_path / "file"
    file.touch()
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        code = main(["doctor", "--state", str(file / "in"), "--port", str(port)])
    out, err = capsys.readouterr()
    assert code == 2
    told = dict(line.split(maxsplit=1) for line in out.splitlines())
    assert "is taken" in told["port"]
    assert "gym" in told["extras"].split("; more by")[0]
    assert "cluster" in told["extras"].split("; more by")[1]
    faults = err.splitlines()
    assert [line.split(": ")[1] for line in faults] == ["packages", "disk", "traffic"]
    assert f"numpy is {metadata.version('numpy')}, not >=99" in faults[0]
    assert "no-such-package is missing" in faults[0]
    assert "cannot be written to" in faults[1]
    assert "no-such-demo" in faults[2]


def test_a_port_that_is_none_is_told_in_a_sentence(capsys):
    """It was a traceback."""
    assert main(["doctor", "--port", "99999"]) == 2
    assert "Port 99999 is outside 1..65535." in capsys.readouterr().err
