"""A Ray cluster that runs work items (extra ``cluster``), and the choice between engines."""

import importlib
import logging
import os
import socket
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, TypeVar

from pd_editor.base.errors import InputError
from pd_editor.experiments.work_engine.local_processes import (
    ONE_THREAD,
    PROCESS_DIED,
    LocalProcesses,
)
from pd_editor.experiments.work_engine.work_engine import (
    WAIT_S,
    WORKER_MARK,
    WorkEngine,
    WorkResult,
    failure_of,
    result_of,
)
from pd_editor.scene.formats.registry import REFERENCES

Item = TypeVar("Item")
Value = TypeVar("Value")

LOCAL_ADDRESS: Final = "local"
"""Address that starts a cluster on this machine for the time of the run."""
_TOKEN_FILE: Final = Path(".ray/auth_token")
"""Below the home folder; ``ray get-auth-token --generate`` writes it."""


@dataclass(frozen=True, kw_only=True)
class RayCluster:
    """Work engine on Ray: one task of one core per item, each with one compute thread.

    A task whose worker or node is lost is run again, once; if it is lost again, it
    fails. Folders of data must be reachable from all nodes under the same paths: tasks
    read them, and the caller writes the results.
    """

    address: str | None = None
    """Address of an existing cluster, such as ``auto`` or ``ray://head:10001``; None or
    ``local``: a new one on this machine."""
    num_workers: int | None = None
    """Number of tasks that run at a time; None: one per core of the cluster."""

    def run(
        self,
        function: Callable[[Item], Value],
        items: Mapping[str, Item],
        *,
        on_result: Callable[[WorkResult[Value]], None],
        on_wait: Callable[[], None] = lambda: None,
    ) -> None:
        """Call ``function`` on every item; see ``WorkEngine.run``.

        Raises:
            InputError: Ray is not installed, or the cluster does not answer.
        """
        if not items:
            return
        with self.connected() as ray:
            task = ray.remote(_result_in).options(num_cpus=1, max_retries=1)
            place = os.getcwd()
            waiting = iter(items.items())
            running: dict[Any, str] = {}
            try:
                while True:
                    most = self._most_submitted(ray)
                    while len(running) < most:
                        found = next(waiting, None)
                        if found is None:
                            break
                        running[task.remote(place, function, *found)] = found[0]
                    if not running:
                        return
                    finished, _ = ray.wait(list(running), num_returns=1, timeout=WAIT_S)
                    if not finished:
                        on_wait()
                    for reference in finished:
                        on_result(_result_of(ray, reference, running.pop(reference)))
            except BaseException:
                for reference in running:
                    ray.cancel(reference, force=True)
                raise

    @property
    def _is_new(self) -> bool:
        """Whether the cluster is started for the run."""
        return self.address in (None, LOCAL_ADDRESS)

    def _most_submitted(self, ray: Any) -> int:
        """Limit of submitted tasks; nodes may join and leave during a run."""
        if self.num_workers is not None and not self._is_new:
            return self.num_workers
        cores = int(ray.cluster_resources().get("CPU", 1))
        # Tasks submitted per core, so that no core waits for the caller.
        return max(cores * 2, 8)

    @contextmanager
    def connected(self) -> Iterator[Any]:
        """Connection to the cluster, ended with the context; runs within it share it.

        Raises:
            InputError: Ray is not installed, or the cluster does not answer.
        """
        ray = _ray()
        is_ours = not ray.is_initialized()
        if is_ours:
            try:
                self._check_reachable()
                ray.init(**self._options())
            except (ImportError, RuntimeError, ValueError, OSError) as error:
                reason = getattr(error, "strerror", None) or str(error).strip()
                reason = reason.splitlines()[0][:200].rstrip(".")
                place = "on this machine" if self._is_new else f"at {self.address}"
                raise InputError(
                    f"The Ray cluster {place} cannot be used: {reason}."
                ) from error
        try:
            yield ray
        finally:
            if is_ours:
                ray.shutdown()

    def _options(self) -> dict[str, Any]:
        """Arguments of ``ray.init``."""
        # Processes of a cluster that runs already inherit nothing from this one.
        added = {REFERENCES: os.environ.get(REFERENCES, "")}
        options: dict[str, Any] = {
            "log_to_driver": False,
            "logging_level": logging.ERROR,
            "runtime_env": {"env_vars": ONE_THREAD | {WORKER_MARK: "1"} | added},
        }
        if not self._is_new:
            return options | {"address": self.address}
        return options | {
            "address": LOCAL_ADDRESS,
            "num_cpus": self.num_workers,
            "include_dashboard": False,
        }

    def _check_reachable(self) -> None:
        """Raise at once if nothing listens; Ray itself would try for minutes."""
        host, _, port = (self.address or "").removeprefix("ray://").rpartition(":")
        if host and port.isdecimal():
            socket.create_connection((host.strip("[]"), int(port)), 5.0).close()


def _result_in(
    folder: str, function: Callable[[Item], Value], key: str, item: Item
) -> WorkResult[Value]:
    """Run one item in the caller's working folder, where paths and modules may be."""
    with suppress(OSError):
        os.chdir(folder)
    return result_of(function, key, item)


def _ray() -> Any:
    """The package ``ray``, quiet about what users need not know."""
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    if os.path.exists(Path.home() / _TOKEN_FILE):
        # Ray uses the token by itself for clusters that it starts or finds only.
        os.environ.setdefault("RAY_AUTH_MODE", "token")
    try:
        ray = importlib.import_module("ray")
    except ImportError as error:
        raise InputError(
            'Ray is not installed; install the extra "cluster" '
            "(pip install 'pd-editor[cluster]'), or use --engine local."
        ) from error
    logging.getLogger("ray").setLevel(logging.ERROR)
    return ray


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


EngineName = Literal["local", "ray"]

MAX_WORKERS: Final = {"local": 256, "ray": 100_000}


@dataclass(frozen=True, kw_only=True)
class EngineChoice:
    """Processes of this machine, or Ray; the results do not depend on it.

    Raises:
        InputError: the number of workers is out of range, or an address is given that
            the engine does not take.
    """

    name: EngineName = "local"
    address: str | None = None
    """Address of a Ray cluster; None starts one on this machine."""
    num_workers: int | None = None
    """Number of items that run at a time; None: one per core."""

    def __post_init__(self) -> None:
        most = MAX_WORKERS[self.name]
        if self.num_workers is not None and not 1 <= self.num_workers <= most:
            raise InputError(f"--workers is {self.num_workers}; expected 1 to {most}.")
        if self.address is not None and self.name != "ray":
            raise InputError("--address is for --engine ray.")

    @contextmanager
    def engine(self) -> Iterator[WorkEngine]:
        """The engine; a connection to a cluster ends with the context.

        Raises:
            InputError: Ray is not installed, or the cluster does not answer.
        """
        if self.name == "local":
            yield LocalProcesses(num_workers=self.num_workers)
            return
        cluster = RayCluster(address=self.address, num_workers=self.num_workers)
        with cluster.connected():
            yield cluster
