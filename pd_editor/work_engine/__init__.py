"""Parallel execution of many work items on local processes."""

from pd_editor.work_engine.local_processes import LocalProcesses
from pd_editor.work_engine.work_engine import WorkEngine, WorkResult, run_items

__all__ = ["LocalProcesses", "WorkEngine", "WorkResult", "run_items"]
