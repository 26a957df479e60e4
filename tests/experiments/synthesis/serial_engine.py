"""A work engine without processes, that may be stopped."""

from pd_editor.experiments.work_engine.work_engine import InThisProcess


class SerialEngine(InThisProcess):
    def __init__(self, stop_after: int | None = None) -> None:
        self.stop_after = stop_after
        self.keys: list[str] = []

    def run(self, function, items, *, on_result, on_wait=lambda: None):
        for number, (key, item) in enumerate(items.items()):
            if number == self.stop_after:
                raise KeyboardInterrupt
            self.keys.append(key)
            super().run(function, {key: item}, on_result=on_result, on_wait=on_wait)
