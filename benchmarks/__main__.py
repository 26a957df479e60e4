"""Runs benchmarks, one after the other: ``python -m benchmarks [NAME ...]``.

Without a name it is the table of times, with ``all`` each of them. What a benchmark needs, PD_EDITOR_AV2, PD_EDITOR_CORPUS or Chromium, its docstring says;
without it, it is skipped aloud. Each runs in a process of its own.
"""

import ast
import os
import platform
import subprocess
import sys
from pathlib import Path

from benchmarks.chromium import chromium_path

FOLDER = Path(__file__).parent


def benchmarks() -> dict[str, str]:
    """Docstring of each module here that has a ``main``."""
    found = {}
    for path in sorted(FOLDER.glob("[a-z]*.py")):
        tree = ast.parse(path.read_text())
        names = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
        if "main" in names:
            found[path.stem] = ast.get_docstring(tree) or ""
    return found


def missing(docstring: str) -> str | None:
    """What a benchmark needs and this machine lacks."""
    for name in ("PD_EDITOR_AV2", "PD_EDITOR_CORPUS"):
        if name in docstring and name not in os.environ:
            return f"{name} is not set"
    if "Chromium" in docstring and chromium_path() is None:
        return "there is no Chromium"
    return None


def machine() -> str:
    """Processor, cores, memory and Python, in words."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    names = [one.split(":")[1].strip() for one in lines if one.startswith("model name")]
    processor = names[0] if names else platform.processor() or platform.machine()
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**30
    return (
        f"{processor}, {os.cpu_count()} cores, {memory:.0f} GiB, "
        f"{platform.system()}, Python {platform.python_version()}"
    )


def run_all() -> int:
    """Run those named on the command line, or the table; the exit code."""
    known = benchmarks()
    named = list(known) if sys.argv[1:] == ["all"] else sys.argv[1:] or ["table"]
    unknown = [name for name in named if name not in known]
    if unknown:
        print(f"No benchmark {', '.join(unknown)}; there are {', '.join(known)}.")
        return 2
    failed = []
    print(f"== {machine()}")
    for name in named:
        lack = missing(known[name])
        if lack:
            print(f"== {name}: SKIPPED, {lack}", flush=True)
            continue
        print(f"== {name} (load {os.getloadavg()[0]:.1f})", flush=True)
        command = [sys.executable, "-m", f"benchmarks.{name}"]
        if subprocess.run(command, cwd=FOLDER.parent, check=False).returncode:
            failed.append(name)
    if failed:
        print(f"== FAILED: {', '.join(failed)}")
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(run_all())
