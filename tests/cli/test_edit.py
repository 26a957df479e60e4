import re
import signal
import socket
import subprocess
import sys
import threading
import urllib.request
from pathlib import Path

import pytest

from pd_editor.scene.base_reference import SceneCut
from pd_editor.viewer import viewer_app
from tests.cli.shell import ROOT, Shell


class FakeApp:
    """Takes the place of the web application."""

    address = "http://127.0.0.1:1"
    made: dict[str, object] | None = None
    stopped = False

    def __init__(self, options: viewer_app.ViewerOptions) -> None:
        FakeApp.made = vars(options)

    def address_at(self, host: str) -> str:
        return f"http://{host}:1"

    def run_forever(self) -> None:
        raise KeyboardInterrupt

    def stop(self) -> None:
        FakeApp.stopped = True


class EarlyInterruptedApp(FakeApp):
    """Is interrupted while its address is printed, before it waits."""

    @property
    def address(self) -> str:
        raise KeyboardInterrupt


def test_interrupting_it_while_its_address_is_printed_is_no_failure(
    shell: Shell, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(viewer_app, "ViewerApp", EarlyInterruptedApp)
    monkeypatch.setattr(FakeApp, "stopped", False)
    result = shell.run("edit")
    assert (result.code, result.err, FakeApp.stopped) == (0, "", True)


def test_interrupting_it_is_no_failure(shell: Shell, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(viewer_app, "ViewerApp", FakeApp)
    result = shell.run("edit", "--data", "somewhere", "--port", 8123)
    assert (result.code, result.err) == (0, "")
    assert result.lines == [
        "Starting...",
        "Path Diffuser Editor is at http://127.0.0.1:1",
    ]
    assert FakeApp.made == {
        "reference": None,
        "host": "127.0.0.1",
        "port": 8123,
        "data_root": Path("somewhere"),
        "library": None,
        "state": None,
        "models": (),
        "debug": False,
        "token": None,
        "cut": SceneCut(),
    }


@pytest.mark.parametrize(
    ("options", "token", "warning"),
    [
        ("--host 127.0.0.2", None, ""),
        ("--token", True, ""),
        ("--host 0.0.0.0", None, "whoever knows it can use it."),
        ("--host 0.0.0.0 --no-token", False, "everybody who reaches it can use it."),
    ],
)
def test_other_machines_are_warned_of_and_need_a_token(
    shell: Shell, monkeypatch: pytest.MonkeyPatch, options, token, warning
):
    monkeypatch.setattr(viewer_app, "ViewerApp", FakeApp)
    result = shell.run("edit", *options.split())
    assert result.code == 0
    assert FakeApp.made is not None
    assert FakeApp.made["token"] is token
    assert result.err.startswith("Warning: other machines reach") is bool(warning)
    assert warning in result.err


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ("--port 0", "Port 0 is outside 1..65535."),
        ("--port 70000", "Port 70000 is outside 1..65535."),
        ("--host 192.0.2.1", "192.0.2.1: cannot be listened on"),
        ("--host ...", "...: cannot be listened on"),
        ("--token --no-token", "--token and --no-token exclude each other."),
        ("nowhere", "nowhere: is neither a scenario folder nor a demo"),
        ("--data nowhere", "nowhere: there is no such dataset folder"),
        (f"--library {__file__}", "test_edit.py: is a file; expected a folder."),
        (f"--state {__file__}", "test_edit.py: is a file; expected a folder."),
        ("--models nowhere", "nowhere: not a trained model"),
    ],
)
def test_what_cannot_be_served_is_refused(shell: Shell, options: str, sentence: str):
    result = shell.run("edit", *options.split())
    assert result.code == 2
    assert sentence in result.err
    assert result.out in ("", "Starting...\n")
    assert result.err.count("\n") == 1


def test_a_taken_port_is_stepped_over(shell: Shell, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(viewer_app, "ViewerApp", FakeApp)
    with socket.create_server(("127.0.0.1", 0)) as taken:
        assert shell.run("edit", "--port", taken.getsockname()[1]).code == 0


@pytest.mark.slow
def test_app_says_that_it_starts_then_prints_its_address_and_serves(tmp_path: Path):
    process = subprocess.Popen(
        [sys.executable, "app.py", "--port", "8391", "--state", str(tmp_path)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    guard = threading.Timer(60, process.kill)
    guard.start()
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "Starting...\n"
        line = process.stdout.readline()
        found = re.fullmatch(r"Path Diffuser Editor is at (http://\S+)\n", line)
        assert found is not None, line
        with urllib.request.urlopen(found[1], timeout=60) as page:
            assert page.status == 200
            assert b"<html" in page.read().lower()
    finally:
        guard.cancel()
        process.send_signal(signal.SIGINT)
        rest, errors = process.communicate(timeout=60)
    assert (process.returncode, errors) == (0, "")
    assert rest.count("\n") <= 1, rest
