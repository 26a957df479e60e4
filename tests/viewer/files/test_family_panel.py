"""The family panel: variants of the edits at hand, in the library."""

from pathlib import Path

import numpy as np

from pd_editor.base.installed_files import demo_names
from pd_editor.editor.commands import DeleteAgents, SetAgentSpeed, SetRoadWarp
from pd_editor.editor.library.library import Library
from pd_editor.editor.recipe import Recipe
from pd_editor.scene.perturbation.warp_scenario import pose_of_anchor
from pd_editor.scene.road_warp import RoadWarp, WarpTerm
from tests.viewer.fake_browser import FakeTab, connected_tab, running_app, until


def warped(tab: FakeTab) -> None:
    """Bend the road, and set a speed."""
    pose = pose_of_anchor(tab.session.scenario, "focal")
    term = WarpTerm(kind="smooth-turn", power=5.0, length_m=30.0)
    speed = SetAgentSpeed(agent_ids=(tab.session.scenario.focal_id,), speed_mps=3.0)
    tab.run(
        lambda: tab.session.apply(
            SetRoadWarp(warp=RoadWarp(anchor=pose, terms=(term,)))
        )
    )
    tab.run(lambda: tab.session.apply(speed))


def test_variants_are_saved_to_the_library(tmp_path: Path):
    library = Library(tmp_path / "kept")
    with (
        running_app(tmp_path / "state", "merge", library=library.root) as app,
        connected_tab(app) as tab,
    ):
        assert "Such as seed=1..99. Now: seed 0" in tab.text()
        warped(tab)
        assert "Such as power=2.5..10. Now: power 5, length 30 m, " in tab.text()
        tab.type("Vary", "power=2..8, speed=1..2")
        tab.type("Variants", 3)
        tab.press("Make family")
        until(lambda: "3 of 3 variants saved to the library (N)" in tab.text())
        cards = library.cards()
        assert len(cards) == 3
        found = {card.name: library.files(card.name) for card in cards}
        # Traffic comes at the end, since the edits have none.
        recipes = [Recipe.from_text(one["recipe.json"]) for one in found.values()]
        assert all(one.generators for one in recipes)
        powers = np.array([card.row.values["power"] for card in cards])
        assert ((powers > 2) & (powers < 8)).all()
        assert (np.diff(np.sort(powers)) > 0).all()
        # The power of the edits at hand is none of theirs.
        assert not any("p5" in card.name for card in cards)
        assert len(tab.tiles("library")) == 3
        # Which values are there is drawn, and what is removed is dropped.
        clean = [not card.row.num_problems for card in cards]
        assert "power 2 to 8" in tab.text()
        for card in cards:
            assert (
                f"{card.name}: power {card.row.values['power']:g}, with" in tab.text()
            )
        assert f"{sum(clean)} without problems" in tab.text()
        tab.choose("library", cards[0].name, "tick")
        tab.hear("startPage", kind="bulk", name="remove")
        until(lambda: "1 dropped" in tab.text())


def test_what_cannot_be_varied_is_told_and_nothing_is_saved(tmp_path: Path):
    library = Library(tmp_path / "kept")
    with (
        running_app(tmp_path / "state", "merge", library=library.root) as app,
        connected_tab(app) as tab,
    ):
        warped(tab)
        tab.press("Make family")
        assert "enter a range first" in tab.refusal()
        tab.type("Vary", "strength=1..2")
        tab.press("Make family")
        assert (
            "there are power, length, border, exponent, speed, seed, x, y"
            in tab.refusal()
        )
        tab.type("Vary", "power=1..2 power=2..3")
        tab.press("Make family")
        assert "Two ranges are of the same number" in tab.refusal()
        tab.type("Vary", "power=50..60")
        tab.press("Make family")
        until(
            lambda: (
                "0 of 10 variants saved to the library (N), 0 without problems. 10 failed"
                in tab.text()
            )
        )
        assert "outside -10..10" in tab.text()
        assert library.cards() == []


def test_a_run_that_is_cancelled_keeps_what_is_saved(tmp_path: Path):
    library = Library(tmp_path / "kept")
    with (
        running_app(tmp_path / "state", "merge", library=library.root) as app,
        connected_tab(app) as tab,
    ):
        warped(tab)
        tab.type("Vary", "power=2..8")
        tab.type("Variants", 200)
        tab.press("Make family")
        until(lambda: library.cards())
        tab.press("Cancel family")
        assert "Cancelled; what is saved stays." in tab.text()
        count = len(library.cards())
        assert 1 <= count < 200
        # Another run begins at once.
        tab.type("Variants", 1)
        tab.press("Make family")
        until(lambda: "1 of 1 variants saved to the library (N)" in tab.text())


def test_the_edits_at_hand_are_made_in_other_scenes(tmp_path: Path):
    library = Library(tmp_path / "kept")
    with (
        running_app(tmp_path / "state", "merge", library=library.root) as app,
        connected_tab(app) as tab,
    ):
        warped(tab)
        focal, other = tab.session.scenario.focal_id, tab.session.scenario.agents.ids[0]
        assert other != focal
        tab.run(lambda: tab.session.apply(DeleteAgents(agent_ids=(other,))))
        tab.type("Make in", "Scenes ticked in the library")
        tab.press("Make family")
        assert "There are no scenes ticked in the library." in tab.refusal()
        tab.type("Make in", "All demos")
        tab.press("Make family")
        count = len(demo_names())
        done = f"{count} of {count} variants saved to the library (N)"
        until(lambda: done in tab.text(), 120)
        assert f"Left out of {count} variants" in tab.text()
        recipes = {
            card.name: Recipe.from_text(library.files(card.name)["recipe.json"])
            for card in library.cards()
        }
        assert {one.base.scenario_id for one in recipes.values()} == set(demo_names())
        assert {one.variant.parent for one in recipes.values()} == {
            tab.session.recipe().result_id
        }
        assert all(one.warps and one.generators for one in recipes.values())
