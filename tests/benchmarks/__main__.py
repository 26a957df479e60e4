"""Runs every benchmark, each in a process of its own."""

import subprocess
import sys
from pathlib import Path


def main() -> int:
    failed = []
    for path in sorted(Path(__file__).parent.glob("*.py")):
        if "def main(" not in path.read_text() or path.name == "__main__.py":
            continue
        print(f"\n== {path.stem} ==", flush=True)
        command = [sys.executable, "-m", f"tests.benchmarks.{path.stem}"]
        if subprocess.run(command, check=False).returncode:
            failed.append(path.stem)
    if failed:
        print(f"\nFailed: {', '.join(failed)}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
