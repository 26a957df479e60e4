"""``pd-editor doctor``: tell whether the editor can do its work on this machine."""

import os
import platform
import shutil
import socket
import tempfile
import time
import webbrowser
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement

from pd_editor.base.errors import InputError, PdEditorError
from pd_editor.base.installed_files import demo_names
from pd_editor.base.plain_text import number_of, one_line
from pd_editor.base.regular_file import state_folder
from pd_editor.cli.edit import check_address
from pd_editor.cli.options import OptionalFolder
from pd_editor.experiments.work_engine.work_engine import WorkFailure, failure_of


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """What was looked at, and what is wrong."""

    findings: Mapping[str, str]
    failures: Mapping[str, WorkFailure] = field(default_factory=dict)

    def __str__(self) -> str:
        """A line for each thing that was looked at and is right."""
        return "\n".join(
            f"{name:<11} {one_line(text)}" for name, text in self.findings.items()
        )


def doctor(*, state: OptionalFolder = None, port: int = 8080) -> Diagnosis:
    """Tell whether the editor can do its work on this machine.

    Looks at Python, packages, the device, disk, port and browser, and fills a demo with
    sampled traffic. Exits with 2 if something is wrong.

    Args:
        state: Folder for unfinished work; ~/.local/state/pd-editor if not given.
        port: Port of the editor.
    """
    checks: dict[str, Callable[[], str]] = {
        "Python": _python,
        "packages": _packages,
        "extras": _extras,
        "device": _device,
        "disk": lambda: _disk(state),
        "port": lambda: _port(port),
        "browser": _browser,
        "traffic": _traffic,
    }
    found, failures = {}, {}
    for name, check in checks.items():
        try:
            found[name] = check()
        except (PdEditorError, ImportError, OSError) as error:
            failures[name] = failure_of(InputError(str(error)))
    return Diagnosis(findings=found, failures=failures)


def _python() -> str:
    return f"{platform.python_version()} on {platform.platform(terse=True)}"


def _missing(extra: str) -> list[str]:
    """Packages of an extra, or of the editor itself, that are absent or out of range."""
    missing = []
    for text in metadata.requires("pd-editor") or ():
        wanted = Requirement(text)
        is_own = wanted.marker is None or wanted.marker.evaluate({"extra": ""})
        if is_own == bool(extra) or not (
            wanted.marker is None or wanted.marker.evaluate({"extra": extra})
        ):
            continue
        try:
            version = metadata.version(wanted.name)
        except metadata.PackageNotFoundError:
            missing.append(f"{wanted.name} is missing")
            continue
        if not wanted.specifier.contains(version, prereleases=True):
            missing.append(f"{wanted.name} is {version}, not {wanted.specifier}")
    return missing


def _packages() -> str:
    if missing := _missing(""):
        raise InputError(f"{', '.join(missing)}; install pd-editor again.")
    return f"all of pd-editor {metadata.version('pd-editor')}"


def _extras() -> str:
    names = metadata.metadata("pd-editor").get_all("Provides-Extra") or ()
    is_there = {name: not _missing(name) for name in names if name != "dev"}
    there = ", ".join(name for name, own in is_there.items() if own)
    absent = ",".join(name for name, own in is_there.items() if not own)
    more = f"; more by: pip install 'pd-editor[{absent}]'" if absent else ""
    return f"{there or 'none'}{more}"


def _device() -> str:
    import torch

    if torch.cuda.is_available():
        return f"{torch.cuda.get_device_name()}, torch {torch.__version__}"
    cores = number_of(os.cpu_count() or 1, "core")
    threads = number_of(torch.get_num_threads(), "thread")
    return f"CPU, {cores}, {threads}, torch {torch.__version__}"


def _disk(state: Path | None) -> str:
    folder = state or state_folder()
    there = next(one for one in (folder, *folder.absolute().parents) if one.exists())
    if not (there.is_dir() and os.access(there, os.W_OK)):
        raise InputError(f"{there}: cannot be written to; choose another --state.")
    free_gb = shutil.disk_usage(there).free / 2**30
    if free_gb < 1.0:
        raise InputError(f"{there}: has {free_gb:.1f} GB left; expected 1 GB.")
    return f"{free_gb:.0f} GB free for unfinished work in {folder}"


def _port(port: int) -> str:
    check_address("127.0.0.1", port)
    with socket.socket() as probe:
        is_taken = probe.connect_ex(("127.0.0.1", port)) == 0
    return f"{port} is {'taken; the editor takes the next free one' if is_taken else 'free'}"


def _browser() -> str:
    try:
        return webbrowser.get().name
    except webbrowser.Error:
        return "none here; open the address from another machine (docs/remote.md)"


def _traffic() -> str:
    from pd_editor.cli.generate import generate

    demo = demo_names()[0]
    with tempfile.TemporaryDirectory() as out:
        begin = time.perf_counter()
        agents = generate(demo, num_agents=("fit",), out=out).scenario.agents
        spent_s = time.perf_counter() - begin
    return f"{demo} filled with {len(agents)} agents and written in {spent_s:.1f} s"
