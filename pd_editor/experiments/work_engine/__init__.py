"""Parallel execution of many work items on local processes or a Ray cluster."""

from pd_editor.experiments.work_engine.engine_choice import EngineChoice, EngineName
from pd_editor.experiments.work_engine.local_processes import LocalProcesses
from pd_editor.experiments.work_engine.work_engine import (
    InThisProcess,
    WorkEngine,
    WorkResult,
    run_items,
)

__all__ = [
    "EngineChoice",
    "EngineName",
    "InThisProcess",
    "LocalProcesses",
    "WorkEngine",
    "WorkResult",
    "run_items",
]
