"""Drives the editor in a real browser, as a person would."""

import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Locator, Page, expect

from pd_editor.editor.session import EditorSession
from pd_editor.viewer.scene.camera import CameraPose, projected
from pd_editor.viewer.viewer_app import ViewerApp
from tests.viewer.fake_browser import inputs_of, node_of, open_tabs, shown_in

SCREENSHOTS = Path(__file__).parent / "screenshots"
PATIENCE_S = 60.0
"""How long to wait for anything: a busy machine is slow, and waiting costs nothing else."""
PAUSE_MS = 90
"""viser's client sends at most one GUI message per 50 ms and keeps only the newest."""


class EditorPage:
    """One tab on an editor that runs in this process."""

    def __init__(self, page: Page, app: ViewerApp) -> None:
        self.page = page
        page.set_default_timeout(1000 * PATIENCE_S)
        expect.set_options(timeout=1000 * PATIENCE_S)
        self.app = app
        self._known = set(app.server.get_clients())
        page.goto(app.address)
        self.attach()

    def reload(self) -> None:
        """Load the page once more."""
        self._known = set(self.app.server.get_clients())
        self.page.reload()
        self.attach()

    def attach(self) -> None:
        """Wait until the page that was loaded last is connected and complete."""
        clients = self.app.server.get_clients
        self.until(lambda: set(clients()) - self._known, "a connection")
        client_id = max(set(clients()) - self._known)
        self._known.add(client_id)
        self.client = clients()[client_id]
        self.until(lambda: self.tab() is not None, "a session")
        self.until(lambda: self.tab().is_built, "the panels")
        self.until(lambda: self.tab().ui.overlay.is_ready, "the overlay")
        self.until(
            lambda: self.page.get_by_role("tab", name="Agents").count() > 0, "the page"
        )
        self.page.evaluate(
            "document.querySelectorAll('.mantine-Notification-closeButton')"
            ".forEach(b => b.closest('.mantine-Notification-root')"
            ".innerText.includes('WebGL') && b.click())"
        )

    def tab(self) -> Any:
        return open_tabs(self.app).get(self.client.client_id)

    def shown(self, element: str) -> Any:
        """What the page was told last to show in an element over the picture."""
        return shown_in(self.tab().ui.overlay, element)

    def field(self, label: str) -> Any:
        """The one input of a label, as the server has it."""
        (handle,) = inputs_of(self.client)[label]
        return handle

    def node(self, name: str) -> Any:
        """A node of the picture, as the server has it, if there is one."""
        return node_of(self.client, name)

    @property
    def seen_camera(self) -> CameraPose:
        """The camera that the page reported last, which may come after the server's."""
        return self.tab().elements.pointer._seen_camera.pose

    def look_from_above(self) -> None:
        """Switch to the top view, and wait until the page shows it."""
        self.key("v")
        self.until(lambda: self.seen_camera.fov < 0.2, "the top view")

    def select(self, agent_ids: Iterable[str]) -> None:
        """Select agents, on the tab's own thread."""
        wanted = tuple(agent_ids)
        self.tab().ui.post(lambda: self.session.select(wanted))
        self.until(lambda: self.session.selection == wanted, "the selection")

    @property
    def session(self) -> EditorSession:
        return self.tab().workspace.session

    @property
    def workspace(self):
        return self.tab().workspace

    def until(
        self, condition: Callable[[], object], what: str, seconds: float = PATIENCE_S
    ):
        """Wait for the server's state; the browser goes on meanwhile."""
        end = time.monotonic() + seconds
        while True:
            value = condition()
            if value:
                return value
            assert time.monotonic() < end, f"waited {seconds} s for {what}"
            self.page.wait_for_timeout(50)

    def close_notifications(self) -> None:
        """Close toasts that cover the picture; they also leave by themselves."""
        self.page.evaluate(
            "document.querySelectorAll('.mantine-Notification-closeButton')"
            ".forEach(button => button.click())"
        )
        self.page.wait_for_timeout(PAUSE_MS)

    def open_tab(self, name: str) -> None:
        self.page.get_by_role("tab", name=name, exact=True).click()
        self.page.wait_for_timeout(PAUSE_MS)

    def open_folder(self, name: str) -> None:
        """Open a part of the panel that is closed at first."""
        head = self.page.get_by_text(name, exact=True)
        head.click()
        # It opens over frames, which a busy machine draws late.
        head.locator("+ div:not([inert])").wait_for()

    def press(self, name: str) -> None:
        """Click a button by its text."""
        self.page.get_by_role("button", name=name, exact=True).first.click()
        self.page.wait_for_timeout(PAUSE_MS)

    @property
    def run_bar(self) -> Locator:
        """The bar that starts runs."""
        return self.page.get_by_role("group", name="Run", exact=True)

    def run(self, verb: str, target: str) -> None:
        """Press a button of the run bar, which names whom the run is about."""
        self.run_bar.get_by_role("button", name=f"{verb} {target}", exact=True).click()
        self.page.wait_for_timeout(PAUSE_MS)

    def choose_scope(self, scope: str) -> None:
        """Choose in the run bar whose trajectories are regenerated."""
        menu = self.run_bar.get_by_role("combobox", name="Agents to regenerate")
        menu.select_option(scope)

    def set_number(self, name: str, value: int) -> None:
        """Type samples or a seed into the run bar."""
        field = self.run_bar.get_by_role("spinbutton", name=name)
        field.fill(str(value))
        field.press("Enter")

    def choose_scene(self, source: str, name: str) -> None:
        """Open a scenario in the page of all scenarios, by mouse."""
        page = self.page.get_by_role("region", name="All scenarios")
        if not page.is_visible():
            self.key("n")
        page.get_by_role("tab", name=source).click()
        page.locator(".pd-start-tile", has_text=name).first.click()
        expect(page).to_be_hidden()

    def pause(self) -> None:
        """Stop playback, if it runs, by the timeline's button."""
        if self.workspace.playback.is_playing:
            self.page.get_by_role("button", name="Pause", exact=True).click()
            self.until(lambda: not self.workspace.playback.is_playing, "a pause")

    def go_to_now(self) -> None:
        """Press t = 0 on the timeline."""
        playback = self.workspace.playback
        self.page.get_by_role("button", name="t = 0", exact=True).click()
        self.until(lambda: playback.step == playback.axis.current_step, "t = 0")
        self.settle()

    def seek(self, time_s: float) -> None:
        """Click the timeline's track at a time, then step to the very frame."""
        playback = self.workspace.playback
        axis = playback.axis
        wanted = axis.current_step + round(time_s / axis.step_s)
        box = self.page.get_by_role("slider", name="Time", exact=True).bounding_box()
        assert box is not None
        x = box["x"] + box["width"] * wanted / (axis.num_steps - 1)
        self.page.mouse.click(x, box["y"] + box["height"] * 0.7)
        self.until(lambda: abs(playback.step - wanted) <= 3, f"t = {time_s} s")
        while playback.step != wanted:
            step = playback.step
            self.key("ArrowRight" if step < wanted else "ArrowLeft")
            self.until(lambda step=step: playback.step != step, "a step")
        self.until(lambda: not self.tab().elements.picture.is_behind, "its picture")

    def row(self, label: str) -> Locator:
        """The row of a labelled input."""
        return self.page.locator(
            f"xpath=//label[normalize-space()='{label}']"
            "/ancestor::div[contains(@class,'Flex-root')][1]"
        ).first

    def fill(self, label: str, *values: object) -> None:
        """Type into the inputs of a row."""
        inputs = self.row(label).locator("input:not([type=hidden])")
        for index, value in enumerate(values):
            inputs.nth(index).fill(str(value))
            inputs.nth(index).press("Enter")
            inputs.nth(index).press("Tab")
            self.page.wait_for_timeout(PAUSE_MS)

    def choose(self, label: str, option: str) -> None:
        """Choose in a dropdown."""
        self.row(label).locator("input:not([type=hidden])").first.click()
        self.page.get_by_role("option", name=option, exact=True).click()
        self.page.wait_for_timeout(PAUSE_MS)

    def tick(self, label: str) -> None:
        """Click a checkbox."""
        box = self.row(label).locator("input[type=checkbox]").first
        # A forced click does not wait until the input is drawn.
        box.wait_for()
        box.click(force=True)
        self.page.wait_for_timeout(PAUSE_MS)

    def key(self, keys: str) -> None:
        """Press keys while the canvas has the focus."""
        self.page.evaluate("document.activeElement && document.activeElement.blur()")
        self.page.keyboard.press(keys)
        self.page.wait_for_timeout(PAUSE_MS)

    def pixel(self, point_m: tuple[float, ...] | np.ndarray) -> tuple[float, float]:
        """Where a point of the scene is on the page."""
        point = np.array([*point_m, 0.0][:3] if len(point_m) == 2 else point_m, float)
        screen, ahead = projected(self.client.camera, point[None])
        assert ahead[0], "the point is behind the camera"
        box = self.page.evaluate(
            "(() => { const r = __viserMutable.canvas.getBoundingClientRect();"
            " return [r.left, r.top, r.width, r.height]; })()"
        )
        x, y = box[0] + screen[0, 0] * box[2], box[1] + screen[0, 1] * box[3]
        assert 0 <= screen[0, 0] <= 1, f"off screen: {screen[0]}"
        assert 0 <= screen[0, 1] <= 1, f"off screen: {screen[0]}"
        return float(x), float(y)

    def settle(self) -> None:
        """Wait until the browser has drawn what it was sent."""
        self.page.wait_for_function("__viserMutable.messageQueue.length === 0")
        frame = self.page.evaluate(
            "(() => { __viserMutable.requestRender();"
            " return __viserTestpoints.rendererInfo.render.frame; })()"
        )
        self.page.wait_for_function(
            f"__viserTestpoints.rendererInfo.render.frame >= {frame} + 2 ||"
            " (__viserMutable.requestRender(), false)"
        )

    def click_at(self, point_m, modifiers: list[str] | None = None) -> None:
        """Click a point of the scene."""
        self.settle()
        x, y = self.pixel(point_m)
        for key in modifiers or []:
            self.page.keyboard.down(key)
        self.page.mouse.move(x, y)
        self.page.wait_for_timeout(PAUSE_MS)
        self.page.mouse.click(x, y)
        for key in modifiers or []:
            self.page.keyboard.up(key)
        self.page.wait_for_timeout(2 * PAUSE_MS)

    def drag(self, start_m, end_m, modifier: str | None = None) -> None:
        """Drag from one point of the scene to another."""
        self.settle()
        self.drag_pixels(self.pixel(start_m), self.pixel(end_m), modifier)

    def drag_pixels(self, start, end, modifier: str | None = None) -> None:
        if modifier:
            self.page.keyboard.down(modifier)
        self.page.mouse.move(*start)
        self.page.wait_for_timeout(2 * PAUSE_MS)
        self.page.mouse.down()
        for fraction in np.linspace(0, 1, 21)[1:]:
            self.page.mouse.move(
                start[0] + fraction * (end[0] - start[0]),
                start[1] + fraction * (end[1] - start[1]),
            )
            self.page.wait_for_timeout(25)
        self.page.wait_for_timeout(2 * PAUSE_MS)
        self.page.mouse.up()
        if modifier:
            self.page.keyboard.up(modifier)
        self.page.wait_for_timeout(2 * PAUSE_MS)

    def screenshot(self, name: str) -> Path:
        """Save what a person sees."""
        SCREENSHOTS.mkdir(exist_ok=True)
        self.settle()
        path = SCREENSHOTS / f"{name}.png"
        self.page.screenshot(path=path)
        return path
