"""The package ``ray`` as far as the engine uses it, in this process."""

import contextlib
import pickle
from types import SimpleNamespace
from typing import Any


class _Lost(Exception):
    pass


class FakeRay:
    """Runs tasks when they are waited for, the newest first, so that order cannot matter.

    ``num_losses`` tasks are lost for good, as if their workers had been killed twice.
    """

    def __init__(self, num_losses: int = 0) -> None:
        self.num_losses = num_losses
        self.started: list[dict[str, Any]] = []
        self.num_ended = 0
        self.most_running = 0
        self.exceptions = SimpleNamespace(
            WorkerCrashedError=_Lost,
            OutOfMemoryError=_Lost,
            NodeDiedError=_Lost,
            ObjectLostError=_Lost,
        )

    def init(self, **options: Any) -> None:
        self.started.append(options)

    def shutdown(self) -> None:
        self.num_ended += 1

    def is_initialized(self) -> bool:
        return len(self.started) > self.num_ended

    def cluster_resources(self) -> dict[str, float]:
        return {"CPU": 2.0}

    def remote(self, function: Any) -> Any:
        def submit(*arguments: Any) -> "_Task":
            return _Task(pickle.dumps((function, arguments)))

        made = SimpleNamespace(remote=submit)
        return SimpleNamespace(options=lambda **_: made)

    def wait(
        self, tasks: list["_Task"], num_returns: int, timeout: float
    ) -> tuple[list, list]:
        assert self.is_initialized()
        self.most_running = max(self.most_running, len(tasks))
        cut = len(tasks) - num_returns
        return tasks[cut:], tasks[:cut]

    def get(self, task: "_Task") -> Any:
        if self.num_losses:
            self.num_losses -= 1
            raise _Lost
        function, arguments = pickle.loads(task.call)
        # A worker of a cluster that runs already has been started anywhere.
        with contextlib.chdir("/"):
            return pickle.loads(pickle.dumps(function(*arguments)))

    def cancel(self, task: "_Task", *, force: bool) -> None:
        pass


class _Task:
    def __init__(self, call: bytes) -> None:
        self.call = call
