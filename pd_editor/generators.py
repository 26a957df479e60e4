"""All generators by name; heavy ones are made when they are asked for."""

from collections.abc import Mapping
from typing import Final

from pd_editor.errors import GenerationError
from pd_editor.generation import GeneratorOffer, ScenarioGenerator


def _lane_follower() -> ScenarioGenerator:
    from pd_editor.lane_follower import LaneFollower

    return LaneFollower()


GENERATORS: Final[Mapping[str, GeneratorOffer]] = {
    "lane-follower": GeneratorOffer(make=_lane_follower),
}
DEFAULT_GENERATOR: Final = "lane-follower"


def make_generator(name: str) -> ScenarioGenerator:
    """The generator of a name.

    Raises:
        GenerationError: there is none.
    """
    if name not in GENERATORS:
        raise GenerationError(
            f"There is no generator {name!r}; choose one of {', '.join(GENERATORS)}."
        )
    return GENERATORS[name].make()
