"""Networks drawn once, for all tests."""

import atexit
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from pd_editor.experiments.synthesis.road_network.generator import generate_network
from pd_editor.experiments.synthesis.road_network.network import Network

_FOLDER = TemporaryDirectory(prefix="networks-")
atexit.register(_FOLDER.cleanup)


@cache
def network(family: str, seed: int) -> Network:
    folder = Path(_FOLDER.name) / f"{family}-{seed}"
    folder.mkdir()
    return generate_network(family, seed, folder)
