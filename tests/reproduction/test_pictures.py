import pytest

from pd_editor.base.errors import GenerationError
from pd_editor.base.installed_files import demo_folder
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.generation import GenerationRequest
from reproduction.pictures import PictureBook
from reproduction.systems import Trained
from tests.experiments.evaluation.small_dataset import Sideways


class SidewaysFrom(Sideways):
    """Slides as well where states are asked for, but with no new agents."""

    def generate(self, request: GenerationRequest):
        if request.num_new_agents:
            raise GenerationError("No new agents.")
        return (yield from super().generate(request))


def trained(system: str, *stages: str) -> Trained:
    return Trained(system=system, seed=0, method=system, stages=stages)


@pytest.mark.slow
def test_each_figure_is_drawn_in_both_formats_or_says_why_not():
    book = PictureBook(
        scenario=read_scenario(demo_folder("roundabout")),
        trained=(trained("pd", "init", "traj"), trained("vd", "traj")),
        make_generator=SidewaysFrom,
    )
    found = {one.name: one for one in book.pictures()}
    assert list(found) == [
        "initial-states",
        "candidates",
        "trajectories",
        "diversity",
        "warped",
    ]
    for one in found.values():
        assert one.png.startswith(b"\x89PNG")
        assert one.pdf.startswith(b"%PDF")
        assert len(one.png) > 2_000
    assert "Frenet candidates of one agent" in found["candidates"].caption
    assert found["diversity"].caption == "Not drawn: No new agents."


def test_without_a_trained_system_the_candidates_are_left():
    book = PictureBook(
        scenario=read_scenario(demo_folder("roundabout")),
        trained=(),
        make_generator=SidewaysFrom,
    )
    assert [one.name for one in book.pictures()] == ["candidates"]
