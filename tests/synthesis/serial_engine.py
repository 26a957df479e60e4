"""A work engine without processes, that may be stopped."""

from pd_editor.work_engine.work_engine import WorkResult, failure_of


class SerialEngine:
    def __init__(self, stop_after: int | None = None) -> None:
        self.stop_after = stop_after
        self.keys: list[str] = []

    def run(self, function, items, *, on_result, on_wait=lambda: None):
        for number, (key, item) in enumerate(items.items()):
            if number == self.stop_after:
                raise KeyboardInterrupt
            self.keys.append(key)
            try:
                value = function(item)
            except Exception as error:  # noqa: BLE001
                on_result(WorkResult(key=key, failure=failure_of(error)))
            else:
                on_result(WorkResult(key=key, value=value))
