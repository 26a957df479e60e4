"""Networks drawn once, for all tests."""

from functools import cache
from pathlib import Path
from tempfile import mkdtemp

from pd_editor.experiments.synthesis.road_network.generator import generate_network
from pd_editor.experiments.synthesis.road_network.network import Network


@cache
def network(family: str, seed: int) -> Network:
    return generate_network(family, seed, Path(mkdtemp(prefix="networks-")))
