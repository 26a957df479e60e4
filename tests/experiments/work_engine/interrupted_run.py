"""A run that a test interrupts; prints its workers' process ids first."""

import sys
import time

from pd_editor.experiments.work_engine.local_processes import LocalProcesses
from pd_editor.experiments.work_engine.work_engine import run_items
from tests.experiments.work_engine.work_functions import process_id, sleep


def say(_, value) -> None:
    sys.stdout.write(f"{value}\n")
    sys.stdout.flush()


def main() -> int:
    engine = LocalProcesses(num_workers=1)
    run_items(engine, process_id, {"id": 0}, on_value=say)
    sys.stdout.write("sleeping\n")
    sys.stdout.flush()
    start = time.monotonic()
    try:
        run_items(engine, sleep, {"long": 60.0, "longer": 90.0}, on_value=say)
    except KeyboardInterrupt:
        return 130 if time.monotonic() - start < 30 else 1
    return 1


if __name__ == "__main__":
    sys.exit(main())
