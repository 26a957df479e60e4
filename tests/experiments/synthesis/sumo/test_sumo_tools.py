from pathlib import Path

import pytest

from pd_editor.base.errors import SynthesisError
from pd_editor.experiments.synthesis.sumo import sumo_tools
from pd_editor.experiments.synthesis.sumo.sumo_tools import (
    SIMULATION_LIMIT_S,
    run_sumo_tool,
    sumo_tool,
)


def test_tools_are_found_where_pip_put_them() -> None:
    assert sumo_tool("netconvert").is_file()


def test_without_sumo_the_extra_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(sumo_tools.shutil, "which", lambda *_, **__: None)
    with pytest.raises(
        SynthesisError,
        match=r"SUMO's netconvert is not installed; .* pip install 'pd-editor\[synth\]'",
    ):
        run_sumo_tool("netconvert", [], tmp_path)


def test_what_sumo_refuses_is_said(tmp_path: Path) -> None:
    (tmp_path / "bad.edg.xml").write_text("<edges><edge/></edges>")
    with pytest.raises(SynthesisError, match="netconvert refused the network"):
        run_sumo_tool(
            "netconvert", ["--edge-files", "bad.edg.xml", "-o", "o.net.xml"], tmp_path
        )


def test_a_tool_that_hangs_is_stopped(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    slow = tmp_path / "netconvert"
    slow.write_text("#!/bin/sh\nexec sleep 30\n")
    slow.chmod(0o755)
    monkeypatch.setattr(sumo_tools, "sumo_tool", lambda _: slow)
    monkeypatch.setattr(sumo_tools, "TIME_LIMIT_S", 0.2)
    with pytest.raises(SynthesisError, match="did not finish within"):
        run_sumo_tool("netconvert", [], tmp_path)


def test_a_simulation_may_take_longer_than_other_tools(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    slow = tmp_path / "sumo"
    slow.write_text("#!/bin/sh\nsleep 0.5 && echo done > finished\n")
    slow.chmod(0o755)
    monkeypatch.setattr(sumo_tools, "sumo_tool", lambda _: slow)
    monkeypatch.setattr(sumo_tools, "TIME_LIMIT_S", 0.1)
    run_sumo_tool("sumo", [], tmp_path, limit_s=SIMULATION_LIMIT_S)
    assert (tmp_path / "finished").read_text() == "done\n"
