"""Switches of branches by real clicks, and frames played, of a real scene with 100 agents.

Needs PD_EDITOR_AV2 and Chromium. Run as ``python -m benchmarks.branches``. One branch
moves 100 agents, the other bends the road. A switch takes from the click until the page
has marked the card and drawn a frame; what the server needs of it stands beside it.
"""

import os
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.chromium import opened_chromium
from benchmarks.edit import NUM_AGENTS, SCENARIO_ID
from benchmarks.figures import load_in_words, spread
from pd_editor.editor.commands import (
    DuplicateAgents,
    SetRoadWarp,
    TransformAgents,
    new_agent_ids,
)
from pd_editor.scene.geometry.rigid_motion import RigidMotion
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from pd_editor.viewer.viewer_app import ViewerApp, ViewerOptions
from tests.browser.editor_page import EditorPage

ROUNDS = 30
CARDS = '[aria-label="Branches"] .pd-sample'
SWITCH = """async ([selector, index]) => {
  const cards = () => [...document.querySelectorAll(selector)];
  const begun = performance.now();
  cards()[index].click();
  while (cards()[index].getAttribute("aria-selected") !== "true")
    await new Promise((done) => setTimeout(done, 1));
  await new Promise((done) => requestAnimationFrame(() => setTimeout(done, 0)));
  return performance.now() - begun;
}"""

PLAY = """async () => {
  const drawn = () => __viserTestpoints.rendererInfo.render.frame;
  const [first, begun] = [drawn(), performance.now()];
  await new Promise((done) => setTimeout(done, 8000));
  return (1000 * (drawn() - first)) / (performance.now() - begun);
}"""


def main() -> None:
    """Switch to and fro, play, and print the medians."""
    folder = Path(os.environ["PD_EDITOR_AV2"]) / "train" / SCENARIO_ID
    in_page: dict[int, list[float]] = {0: [], 1: [], 2: []}
    on_server: dict[int, list[float]] = {0: [], 1: [], 2: []}
    with tempfile.TemporaryDirectory() as state, opened_chromium() as browser:
        app = ViewerApp(ViewerOptions(reference=str(folder), port=0, state=Path(state)))
        try:
            editor = EditorPage(
                browser.new_page(viewport={"width": 1600, "height": 900}), app
            )
            session, ui = editor.session, editor.tab().ui
            editor.go_to_now()
            scenario = session.scenario
            agents, now = scenario.agents, scenario.current_step
            there = [agents.ids[row] for row in np.flatnonzero(agents.is_valid[:, now])]
            missing = NUM_AGENTS - len(there)
            new_ids = new_agent_ids(scenario, missing, "copy")
            copied = DuplicateAgents(
                agent_ids=tuple(there[:missing]), new_ids=new_ids, dx_m=1.0
            )
            ids = (*there, *new_ids)
            move = TransformAgents(agent_ids=ids, dx_m=1.0)
            term = WarpTerm(kind="smooth-turn", power=5.0, length_m=10.0)
            x, y = agents.position_m[agents.row_of[there[0]], now].tolist()
            anchor = RigidMotion(x_m=x, y_m=y, rotation_rad=0.0)
            bend = SetRoadWarp(warp=RoadWarp(anchor=anchor, terms=(term,)))
            for act in (
                lambda: session.apply(copied),
                lambda: session.apply(move),
                session.undo,
                lambda: session.apply(bend),
            ):
                ui.post(act)
            editor.until(lambda: len(session.branches) == 3, "the branches")
            tips = [one.number for one in session.branches]
            editor.key("u")
            editor.until(lambda: editor.page.locator(CARDS).count() == 3, "cards")
            editor.page.wait_for_timeout(3000)
            for number in range(3 * ROUNDS):
                index = number % 3
                in_page[index].append(editor.page.evaluate(SWITCH, [CARDS, index]))
                editor.page.wait_for_timeout(300)
            for number in range(3 * ROUNDS):
                done: list[float] = []

                def switch(index: int = number % 3, done: list[float] = done) -> None:
                    begun = time.perf_counter()
                    session.go_to(tips[index])
                    done.append(1000 * (time.perf_counter() - begun))

                ui.post(switch)
                editor.until(lambda done=done: done, "a switch")
                on_server[number % 3].extend(done)
                editor.page.wait_for_timeout(300)
            editor.select(())
            editor.key("u")
            editor.key("Space")
            print(f"{editor.page.evaluate(PLAY):.1f} frames a second while playing")
        finally:
            app.stop()
    for index, name in enumerate(("the recording", "100 moved", "bent")):
        print(
            f"to {name}: {spread(in_page[index])} ms in the page,"
            f" {spread(on_server[index])} ms on the server"
        )
    print(load_in_words())


if __name__ == "__main__":
    main()
