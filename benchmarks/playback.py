"""What 30 Hz playback of 100 agents costs the server.

Needs PD_EDITOR_AV2. Run as ``python -m benchmarks.playback``. The server runs in a
process of its own, whose processor time Linux counts in /proc; a websocket client that
reads everything, and answers nothing but its camera, stands in for the browser.
"""

import asyncio
import multiprocessing
import os
import tempfile
import time
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path

import msgspec.msgpack
import numpy as np
import viser
import websockets
import zstandard

from benchmarks.figures import load_in_words, spread
from pd_editor.scene.agent_kind import AgentCategory
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.av2_io.write import scenario_files
from pd_editor.scene.bundle import write_files
from pd_editor.scene.scenario import Scenario

NUM_AGENTS = 100
CROWDED_SCENARIO = "000b25a9-8f75-46eb-90f5-a75c985f6ae2"
WINDOW_S = 10.0
RUNS = 3
CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (0.0, -20.0, 20.0),
    "image_height": 600,
    "image_width": 900,
    "fov": 0.75,
    "near": 0.1,
    "far": 1000.0,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}


def always_there(scenario: Scenario) -> Scenario:
    """A hundred agents that are there at every step: the fullest tracks, and copies."""
    agents = scenario.agents
    full = agents.taken(np.flatnonzero(agents.is_valid.all(axis=1)))
    crowd = full
    while len(crowd) < NUM_AGENTS:
        number = len(crowd)
        copy = replace(
            full,
            ids=tuple(f"{agent_id}-{number}" for agent_id in full.ids),
            categories=(AgentCategory.UNSCORED,) * len(full),
            position_m=full.position_m + 0.1 * number,
        )
        crowd = crowd.joined(copy)
    return replace(scenario, agents=crowd.taken(range(NUM_AGENTS)))


def serve(reference: str, library: str, pipe: Connection) -> None:
    """Run the editor until told to stop."""
    from pd_editor.viewer.viewer_app import ViewerApp, ViewerOptions

    app = ViewerApp(ViewerOptions(reference=reference, port=0, state=Path(library)))
    pipe.send(app.address)
    pipe.recv()
    app.stop()


def processor_s(process_id: int) -> float:
    """Processor time that a process has used, of all its threads."""
    fields = Path(f"/proc/{process_id}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


async def watched(address: str, process_id: int) -> list[tuple[float, float, float]]:
    """Share of a core, frames a second and kB a second, for some windows of time."""
    found = []
    protocol = websockets.Subprotocol(f"viser-v{viser.__version__}")
    async with websockets.connect(
        address.replace("http", "ws"),
        subprotocols=[protocol],
        compression=None,
        max_size=None,
    ) as connection:
        await connection.send(msgspec.msgpack.encode(CAMERA))
        # The local storage never answers; the editor gives up on it after some seconds.
        await counted(connection, 6.0)
        for _ in range(RUNS):
            used, start = processor_s(process_id), time.perf_counter()
            frames, size = await counted(connection, WINDOW_S)
            passed = time.perf_counter() - start
            used = processor_s(process_id) - used
            found.append((100 * used / passed, frames / passed, size / passed / 1e3))
    return found


async def counted(
    connection: websockets.ClientConnection, duration_s: float
) -> tuple[int, int]:
    """Read for a while: messages that move agents, and bytes."""
    frames = size = 0
    end = time.perf_counter() + duration_s
    while (rest := end - time.perf_counter()) > 0:
        try:
            message = await asyncio.wait_for(connection.recv(), rest)
        except TimeoutError:
            break
        assert isinstance(message, bytes)
        size += len(message)
        frames += moves_agents(message)
    return frames, size


def moves_agents(message: bytes) -> bool:
    """Whether a batch of viser messages has new positions of agents' bodies."""
    packed = int.from_bytes(message[8:16], "little")
    text = zstandard.ZstdDecompressor().decompress(message[16 : 16 + packed])
    return any(
        m.get("name", "").startswith("/agents/")
        and "batched_positions" in m.get("updates", {})
        for m in msgspec.msgpack.decode(text)["messages"]
    )


def main() -> None:
    """Print the cost of playback."""
    root = Path(os.environ["PD_EDITOR_AV2"])
    scenario = always_there(read_scenario(root / "train" / CROWDED_SCENARIO))
    spawning = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as folder:
        reference = Path(folder) / "crowd"
        write_files(scenario_files(scenario), reference, forbidden=None)
        pipe, other = spawning.Pipe()
        process = spawning.Process(
            target=serve, args=(str(reference), str(Path(folder) / "library"), other)
        )
        process.start()
        assert process.pid is not None
        found = asyncio.run(watched(pipe.recv(), process.pid))
        pipe.send("stop")
        process.join()
    share, frames, size = map(list, zip(*found, strict=True))
    print(
        f"playback of {len(scenario.agents)} agents, {RUNS} windows of {WINDOW_S:.0f} s,"
        f" {load_in_words()}"
    )
    print(f"  server, percent of one core          {spread(share)}")
    print(f"  frames sent / s                      {spread(frames)}")
    print(f"  kB sent / s                          {spread(size)}")


if __name__ == "__main__":
    main()
