"""Choice of the engine on which a command runs its work items."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final, Literal

from pd_editor.base.errors import InputError
from pd_editor.experiments.work_engine.local_processes import LocalProcesses
from pd_editor.experiments.work_engine.ray_cluster import RayCluster
from pd_editor.experiments.work_engine.work_engine import WorkEngine

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
