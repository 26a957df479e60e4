"""What the export panel tells before anything is exported."""

from pathlib import Path
from unittest import mock

import pd_editor
from pd_editor.editor.commands import (
    DeleteAgents,
    RemoveAllAgents,
    SampleSignals,
    SetAgentSpeed,
)
from pd_editor.editor.variant import Variant
from pd_editor.scene.formats.figure import FigureLook
from pd_editor.scene.formats.film import FilmLook
from pd_editor.scene.formats.pictures import LOOKS
from pd_editor.scene.formats.registry import formats
from tests.scene.formats.embedded_scenes import scenes_in
from tests.viewer.fake_browser import connected_tab, running_app, until
from tests.viewer.files.test_family_panel import warped
from tests.viewer.scene.test_plans_view import roll_out


def test_a_disk_that_fails_is_told_until_it_works_again(tmp_path: Path):
    """(Reliability 6): the page learnt it late, and the journal was not tried again."""
    library = tmp_path / "library"
    library.write_text("in the way")
    with running_app(library, "crosswalk") as app, connected_tab(app) as tab:
        session = tab.session

        def told() -> str:
            """What the red line on the picture says."""
            return tab.shown("status")["unsaved"]

        assert told() == ""
        command = SetAgentSpeed(agent_ids=(session.scenario.focal_id,), speed_mps=3.0)
        tab.run(lambda: session.apply(command))
        assert told().startswith("Edits are not saved: ")
        # Once is enough: the panel tells what the export lacks.
        assert "No new problems" in tab.text()
        assert "not saved" not in tab.text()
        with mock.patch.object(tab.ui.client, "send_file_download") as send:
            tab.press("Download the edits alone")
        (name, content), _ = send.call_args
        assert name == "crosswalk-1-edit.recipe.json"
        assert b"SetAgentSpeed" in content
        library.unlink()
        until(lambda: not told())
        assert session.journal_path is not None


def test_an_ego_and_a_focal_agent_that_are_missing_are_told(tmp_path: Path):
    """(D6): an export lacked both, and nothing said so."""
    with (
        running_app(tmp_path / "library", "signalised-junction") as app,
        connected_tab(app) as tab,
    ):
        assert "\nNo new problems" in tab.text()
        tab.run(lambda: tab.session.apply(DeleteAgents(agent_ids=("AV",))))
        assert "\nNo ego · " in tab.text()
        tab.run(lambda: tab.session.apply(RemoveAllAgents()))
        assert "\nNo focal agent · no ego · " in tab.text()


def test_a_name_that_was_cleared_is_proposed_for_the_next_scenario(tmp_path: Path):
    with (
        running_app(tmp_path / "library", "signalised-junction") as app,
        connected_tab(app) as tab,
    ):
        assert tab.field("Name").value == "signalised-junction"
        tab.type("Name", "")
        tab.run(tab.model.shown.emit)
        # Not filled at once: the user may be about to type another name.
        assert tab.field("Name").value == ""
        tab.choose("demos", "crosswalk")
        assert tab.field("Name").value == "crosswalk"


def test_what_is_typed_while_the_panel_is_shown_again_is_not_lost(tmp_path: Path):
    """An edit's refresh, just after the user typed, put the proposed name over it."""
    with (
        running_app(tmp_path / "library", "signalised-junction") as app,
        connected_tab(app) as tab,
    ):
        session = tab.session

        def typed_and_refreshed() -> None:
            # While the worker is busy, so that it takes what was typed only after this.
            tab.type("Name", "My slow one!")
            tab.type("Tags", "slow, bent")
            tab.type("Note", "a note")
            assert session.variant == Variant()
            tab.model.shown.emit()

        tab.run(typed_and_refreshed)
        tab.run(lambda: None)
        assert session.variant == Variant(
            name="My-slow-one", tags=("slow", "bent"), note="a note"
        )
        assert tab.field("Name").value == "My slow one!"
        assert tab.field("Tags").value == "slow, bent"
        assert tab.field("Note").value == "a note"


def test_the_edited_scene_downloads_as_a_player(tmp_path: Path):
    with (
        running_app(tmp_path / "library", "merge") as app,
        connected_tab(app) as tab,
        mock.patch.object(tab.ui.client, "send_file_download") as send,
    ):
        scenario = tab.session.scenario
        other = next(one for one in scenario.agents.ids if one != scenario.focal_id)
        tab.run(lambda: tab.session.apply(DeleteAgents(agent_ids=(other,))))
        # (It was found in the menu of formats alone.)
        tab.type("Download", "Player")
        (name, content), _ = send.call_args
        assert tab.field("Format").value == "Player (HTML)"
        (data,) = scenes_in(content)
        assert name == f"{tab.session.name}.html" == f"{data['name']}.html"
        assert [one["id"] for one in data["agents"]] == list(
            tab.session.scenario.agents.ids
        )


def test_what_a_format_does_not_keep_is_told_before_the_download(tmp_path: Path):
    with (
        running_app(tmp_path / "library", "signalised-junction") as app,
        connected_tab(app) as tab,
    ):
        assert "Not kept" not in tab.text()
        tab.type("Format", "SUMO")
        write = formats()["sumo"].write
        assert write is not None
        losses = write(tab.session.scenario).losses
        assert len(losses) > 2
        assert " ".join(losses) in tab.text()
        # What is edited later is told as it is written.
        tab.run(lambda: tab.session.apply(SampleSignals(seed=0)))
        after = write(tab.session.scenario).losses
        assert after != losses
        assert " ".join(after) in tab.text()
        tab.type("Format", "Argoverse 2")
        assert "Not kept" not in tab.text()


def test_films_and_figures_are_drawn_beside_the_work(tmp_path: Path):
    with (
        running_app(tmp_path / "library", "merge") as app,
        connected_tab(app) as tab,
        mock.patch.object(tab.ui.client, "send_file_download") as send,
    ):
        tab.type("Format", "Figure (SVG)")
        tab.press("Download SVG")
        until(lambda: send.called)
        (name, content), _ = send.call_args
        assert name == f"{tab.session.name}.svg"
        assert b"<svg" in content
        tab.type("Format", "Film (MP4)")
        with mock.patch.dict(LOOKS, {"mp4": FilmLook(height_px=120)}):
            tab.press("Download MP4")
            # Meanwhile the scene is edited, which is no part of this film.
            tab.run(lambda: tab.session.apply(RemoveAllAgents()))
            until(lambda: send.call_count == 2)
        (name, content), _ = send.call_args
        assert name == "merge.mp4"
        assert b"ftyp" in content[:12]


def test_a_film_is_cancelled(tmp_path: Path):
    """Until it was drawn, there could be no other."""
    with (
        running_app(tmp_path / "library", "merge") as app,
        connected_tab(app) as tab,
        mock.patch.object(tab.ui.client, "send_file_download") as send,
    ):
        tab.type("Format", "Film (MP4)")
        tab.press("Download MP4")
        tab.press("Cancel drawing")
        tab.type("Format", "Figure (SVG)")
        tab.press("Download SVG")
        until(lambda: send.called)
        assert [call.args[0] for call in send.call_args_list] == ["merge.svg"]


def test_a_film_has_the_plans_of_the_roll_out(tmp_path: Path):
    with (
        running_app(tmp_path / "library", "merge") as app,
        connected_tab(app) as tab,
        mock.patch("pd_editor.viewer.files.export_panel.picture") as drawn,
    ):
        drawn.return_value = b""
        roll_out(tab)
        tab.type("Format", "Film (MP4)")
        tab.press("Download MP4")
        until(lambda: drawn.called)
        (plans,) = drawn.call_args.args[2].plans.values()
        assert list(plans) == [49, 54]


def test_a_figure_follows_the_agent_that_is_selected(tmp_path: Path):
    """It stood on the focal agent whatever was selected."""
    with (
        running_app(tmp_path / "library", "merge") as app,
        connected_tab(app) as tab,
        mock.patch.object(tab.ui.client, "send_file_download") as send,
        mock.patch.object(tab.ui, "notify", wraps=tab.ui.notify) as notify,
    ):
        scenario = tab.session.scenario
        other = next(one for one in scenario.agents.ids if one != scenario.focal_id)
        tab.type("Format", "Figure (SVG)")
        for count, (selection, whom) in enumerate(
            [
                ((), "about the focal agent"),
                ((other,), f"following {other}"),
                ((other, scenario.focal_id), "about the focal agent"),
            ],
            start=1,
        ):
            tab.run(lambda ids=selection: tab.session.select(ids))
            tab.press("Download SVG")
            assert notify.call_args.args[0].endswith(f".svg, {whom}")
            until(lambda count=count: send.call_count == count)
        middle, followed, several = (call.args[1] for call in send.call_args_list)
        assert middle == several != followed


def test_films_are_neither_packed_nor_written(tmp_path: Path):
    with running_app(tmp_path / "library", "merge") as app, connected_tab(app) as tab:
        tab.type("Format", "Film (WEBM)")
        tab.type("Into folder", str(tmp_path / "out"))
        tab.press("Write to folder")
        assert "Film (WEBM) is only downloaded" in tab.refusal()
        assert not (tmp_path / "out").exists()


def test_what_cannot_be_drawn_is_told(tmp_path: Path):
    with running_app(tmp_path / "library", "merge") as app, connected_tab(app) as tab:
        tab.type("Format", "Figure (PDF)")
        with mock.patch.dict(LOOKS, {"pdf": FigureLook(width_mm=1.0)}):
            tab.press("Download PDF")
            until(lambda: len(tab.notices) > 1)
            assert "20 to 1000 mm" in tab.refusal()


def test_moments_and_the_original_of_a_figure_are_chosen(tmp_path: Path):
    with (
        running_app(tmp_path, "crosswalk") as app,
        connected_tab(app) as tab,
        mock.patch.object(tab.ui.client, "send_file_download") as send,
    ):
        assert not tab.field("Moments").visible
        tab.type("Format", "Figure (SVG)")
        until(lambda: tab.field("Moments").visible)
        tab.type("Moments", "0, 2 4;")
        tab.press("Download SVG")
        until(lambda: send.called)
        content = send.call_args[0][1].decode()
        assert content.count('id="axes_') == 3
        tab.type("Moments", "soon")
        tab.press("Download SVG")
        until(lambda: "expected numbers such as 0, 2, 4" in str(tab.notices))
        tab.type("Moments", "")
        tab.type("Original above", True)
        tab.press("Download SVG")
        until(lambda: "has no original to compare with" in str(tab.notices))
        warped(tab)
        tab.press("Download SVG")
        until(lambda: send.call_count == 2)
        assert send.call_args[0][1].decode().count('id="axes_') == 2
        tab.type("Format", "Argoverse 2")
        until(lambda: not tab.field("Original above").visible)


def test_the_original_of_an_export_is_shown(tmp_path: Path):
    """Only the shell read it from the recipe."""
    made = pd_editor.warp("crosswalk", kind="smooth-turn", power=6, out=tmp_path)
    twice = pd_editor.warp(made.folder, kind="ripple-road", power=3, out=tmp_path)
    files = {one.name: one.read_bytes() for one in made.folder.iterdir()}
    with (
        running_app(tmp_path / "library", "merge") as app,
        connected_tab(app) as tab,
        mock.patch.object(tab.ui.client, "send_file_download") as send,
    ):
        workspace = tab.tab.workspace

        def original() -> dict | None:
            tab.type("Format", "Player (HTML)")
            tab.press("Download HTML")
            return scenes_in(send.call_args[0][1])[0]["original"]

        for opened in (
            lambda: workspace.open_reference(str(made.folder)),
            lambda: workspace.open_reference(str(twice.folder)),
            lambda: workspace.open_upload(files),
        ):
            tab.run(opened)
            shown = original()
            assert shown is not None
            assert shown["lines"]
        tab.type("Format", "Figure (SVG)")
        tab.type("Original above", True)
        tab.press("Download SVG")
        until(lambda: b'id="axes_2"' in send.call_args[0][1])
        # What nobody here has is told, and the page does without it.
        tab.run(lambda: workspace.open_reference(str(twice.folder)))
        made.folder.rename(tmp_path / "moved")
        assert original() is None
        assert tab.notices[-1][0] == "Without the original"
        tab.type("Format", "Figure (SVG)")
        tab.press("Download SVG")
        assert "is not here" in tab.refusal()
