"""Runs work items on a Ray cluster (extra ``cluster``)."""

import importlib
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final, TypeVar

from pd_editor.errors import InputError
from pd_editor.work_engine.local_processes import ONE_THREAD, PROCESS_DIED
from pd_editor.work_engine.time_limit import WORKER_MARK
from pd_editor.work_engine.work_engine import WorkResult, failure_of, result_of

Item = TypeVar("Item")
Value = TypeVar("Value")

LOCAL_ADDRESS: Final = "local"
"""Address that starts a cluster on this machine for the time of the run."""
_QUEUED_PER_CORE: Final = 2
"""Tasks submitted per core, so that no core waits for the caller."""
_LEAST_WAITING: Final = 8


@dataclass(frozen=True, kw_only=True)
class RayCluster:
    """Work engine on Ray: one task of one core per item, each with one compute thread.

    A task whose worker or node is lost is run again, once; if it is lost again, it
    fails. Folders of data and results must be reachable from all nodes under the same
    paths: tasks read them, and the caller writes the results.
    """

    address: str | None = None
    """Address of an existing cluster, such as ``auto`` or ``ray://head:10001``; None or
    ``local``: a new one on this machine."""
    num_workers: int | None = None
    """Number of cores of a new cluster; None: those of this machine."""

    def run(
        self,
        function: Callable[[Item], Value],
        items: Mapping[str, Item],
        *,
        on_result: Callable[[WorkResult[Value]], None],
    ) -> None:
        """Call ``function`` on every item; see ``WorkEngine.run``.

        Raises:
            InputError: Ray is not installed, or the cluster does not answer.
        """
        if not items:
            return
        with self._connected() as ray:
            task = ray.remote(result_of).options(num_cpus=1, max_retries=1)
            waiting = iter(items.items())
            running: dict[Any, str] = {}
            try:
                while True:
                    cores = int(ray.cluster_resources().get("CPU", 1))
                    most = max(cores * _QUEUED_PER_CORE, _LEAST_WAITING)
                    while len(running) < most:
                        found = next(waiting, None)
                        if found is None:
                            break
                        running[task.remote(function, *found)] = found[0]
                    if not running:
                        return
                    finished, _ = ray.wait(list(running), num_returns=1)
                    for reference in finished:
                        on_result(_result_of(ray, reference, running.pop(reference)))
            except BaseException:
                for reference in running:
                    ray.cancel(reference, force=True)
                raise

    @contextmanager
    def _connected(self) -> Iterator[Any]:
        """Connection to the cluster, ended with the context."""
        ray = _ray()
        options: dict[str, Any] = {
            "log_to_driver": False,
            "runtime_env": {"env_vars": {**ONE_THREAD, WORKER_MARK: "1"}},
        }
        if self.address in (None, LOCAL_ADDRESS):
            options |= {
                "address": LOCAL_ADDRESS,
                "num_cpus": self.num_workers,
                "include_dashboard": False,
            }
        else:
            options["address"] = self.address
        is_ours = not ray.is_initialized()
        if is_ours:
            try:
                ray.init(**options)
            except (ConnectionError, RuntimeError, ValueError, OSError) as error:
                reason = str(error).strip().splitlines()[0][:200]
                raise InputError(
                    f"The Ray cluster at {self.address} cannot be used: {reason}"
                ) from error
        try:
            yield ray
        finally:
            if is_ours:
                ray.shutdown()


def _ray() -> Any:
    """The package ``ray``, quiet about what users need not know.

    Raises:
        InputError: it is not installed.
    """
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    try:
        return importlib.import_module("ray")
    except ImportError as error:
        raise InputError(
            'Ray is not installed; install the extra "cluster" '
            "(pip install 'pd-editor[cluster]'), or use --engine local."
        ) from error


def _result_of(ray: Any, reference: Any, key: str) -> WorkResult[Any]:
    """Result of a task, or a failure if it was lost or could not be pickled."""
    try:
        return ray.get(reference)
    except (
        ray.exceptions.WorkerCrashedError,
        ray.exceptions.OutOfMemoryError,
        ray.exceptions.NodeDiedError,
        ray.exceptions.ObjectLostError,
    ):
        return WorkResult(key=key, failure=PROCESS_DIED)
    except Exception as error:  # noqa: BLE001  (pickling raises errors of any class)
        return WorkResult(key=key, failure=failure_of(error))
