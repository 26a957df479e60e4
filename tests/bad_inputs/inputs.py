"""Bad inputs of eight kinds; the seed and the number decide everything about one."""

import contextlib
import io
import json
import logging
import os
import shutil
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import viser
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from pd_editor.analysis.findings.check import scene_problems
from pd_editor.base.installed_files import demo_folder, models_folder
from pd_editor.cli.main import main
from pd_editor.editor.commands import AdoptTrajectory, SetAgentSpeed, traffic_command
from pd_editor.editor.recipe import Recipe
from pd_editor.editor.scenario_store import exported_files, open_scenario
from pd_editor.editor.session import EditorSession
from pd_editor.editor.unfinished_work import Journal, find_unfinished, restore
from pd_editor.generation.generators import SHIPPED_MODEL
from pd_editor.generation.lane_follower import LaneFollower
from pd_editor.scene.av2_io.map_file import map_bytes
from pd_editor.scene.av2_io.upload import scenario_from_upload
from pd_editor.scene.av2_io.write import tracks_bytes
from pd_editor.scene.generation import GenerationRequest, run_to_end
from pd_editor.scene.paths.motion_primitives import candidates
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.meshes.road_mesh import road_parts
from tests.bad_inputs.mutations import (
    ODD_TEXTS,
    ODD_VALUES,
    json_text,
    spoiled_bytes,
    spoiled_json,
)
from tests.viewer.fake_browser import CAMERA, connected_tab, running_app

Action = Callable[[], object]
DEMO = "roundabout"


def scene() -> Scenario:
    """A demo with its first agents, so that many inputs are quick."""
    opened = open_scenario(DEMO)
    rows = [opened.agents.row_of[opened.focal_id]]
    rows += [row for row in range(8) if row not in rows]
    return replace(opened, agents=opened.agents.taken(rows))


def looked_at(scenario: Scenario) -> None:
    """What opening, editing and exporting a scenario does, without a browser."""
    road_parts(scenario.road_map)
    scene_problems(scenario)
    if scenario.time_axis.num_future_steps:
        there = scenario.agents.is_valid[:, scenario.current_step]
        candidates(scenario, np.flatnonzero(there)[:5])
    session = EditorSession(scenario)
    scenario_from_upload(
        {
            name: data
            for name, data in exported_files(scenario, session.recipe()).items()
            if name != "recipe.json"
        }
    )


def tracks(random: np.random.Generator, folder: Path) -> Action:
    """A spoiled track file beside a good map."""
    base = scene()
    data = tracks_bytes(base)
    if random.random() < 0.3:
        data = spoiled_bytes(data, random)
    else:
        table = pq.read_table(pa.BufferReader(data))
        for _ in range(random.integers(1, 3)):
            table = _spoiled_table(table, random)
            # What no Parquet file can hold is not kept.
            with contextlib.suppress(pa.ArrowException):
                sink = io.BytesIO()
                pq.write_table(table, sink)
                data = sink.getvalue()
    files = {"scenario_x.parquet": data, "log_map_archive_x.json": _map_of(base)}
    return _opens(files, folder)


def maps(random: np.random.Generator, folder: Path) -> Action:
    """A spoiled map beside good tracks."""
    base = scene()
    archive = json.loads(_map_of(base))
    kind = random.integers(8)
    if kind == 0:
        number = int(10 ** random.uniform(1, 4))
        one = next(iter(archive["lane_segments"].values()))
        archive["lane_segments"] = {str(n): one | {"id": n} for n in range(number)}
    elif kind == 1:
        scale = float(10 ** random.uniform(0, 4))
        for section in ("lane_segments", "drivable_areas"):
            for entry in archive[section].values():
                for line in entry.values():
                    for point in line if isinstance(line, list) else ():
                        if isinstance(point, dict):
                            point["x"] *= scale
    elif kind == 2:
        size, count = float(10 ** random.uniform(0, 4)), int(random.integers(3, 4000))
        ring = random.uniform(-size, size, (count, 2)).tolist()
        area = [{"x": x, "y": y, "z": 0.0} for x, y in ring]
        archive["drivable_areas"] = {"1": {"id": 1, "area_boundary": area}}
    elif kind == 3:
        ids = [int(name) for name in archive["lane_segments"]]
        for entry in archive["lane_segments"].values():
            entry["successors"] = [int(one) for one in random.permutation(ids)]
            entry["predecessors"] = ids
    else:
        archive = spoiled_json(archive, random)
    files = {
        "scenario_x.parquet": tracks_bytes(base),
        "log_map_archive_x.json": json_text(archive, random),
    }
    return _opens(files, folder)


def recipes(random: np.random.Generator, folder: Path) -> Action:
    """A spoiled recipe on a demo."""
    recipe = _edited(open_scenario(DEMO)).recipe()
    data = json_text(spoiled_json(json.loads(recipe.to_text()), random), random)
    path = folder / "recipe.json"
    path.write_bytes(data)
    Recipe.from_text(recipe.to_text())
    return lambda: main(["replay", str(path), "--out", str(folder / "out")])


def journals(random: np.random.Generator, folder: Path) -> Action:
    """A journal with spoiled lines, or beside odd files."""
    base = open_scenario(DEMO)
    session = _edited(base, Journal(folder))
    session.close(discard=False)
    (path,) = folder.glob("*.journal")
    lines = path.read_bytes().splitlines()
    for _ in range(random.integers(1, 3)):
        at = int(random.integers(len(lines)))
        with contextlib.suppress(ValueError):
            value = spoiled_json(json.loads(lines[at]), random)
            lines[at] = json_text(value, random).replace(b"\n", b" ")
    path.write_bytes(b"\n".join(lines) + b"\n")
    if random.random() < 0.1:
        path.unlink()
        os.mkfifo(path)

    def take_up() -> int:
        logging.basicConfig(format="%(levelname)s %(message)s", force=True)
        found = find_unfinished(folder)
        for work in found:
            restore(work, base).close(discard=False)
        return 0 if found else 2

    return take_up


def models(random: np.random.Generator, folder: Path) -> Action:
    """A spoiled copy of the shipped model."""
    model = shutil.copytree(models_folder() / SHIPPED_MODEL, folder / "model")
    if random.random() < 0.75:
        path = model / "config.json"
        config = json.loads(path.read_text())
        stage = config["stages"][str(random.choice(list(config["stages"])))]
        if random.random() < 0.7:
            stage["config"] = spoiled_json(stage["config"], random)
        else:
            config = spoiled_json(config, random)
        path.write_bytes(json_text(config, random))
    else:
        path = model / str(
            random.choice(["initial_states.safetensors", "trajectories.safetensors"])
        )
        path.write_bytes(spoiled_bytes(path.read_bytes(), random))

    def use() -> int:
        out = ["--out", str(folder / "out")]
        agent = open_scenario(DEMO).focal_id
        return main(["generate", DEMO, "--agents", agent, "--model", str(model), *out])

    return use


def uploads(random: np.random.Generator, folder: Path) -> Action:
    """A spoiled zip, or files under odd names."""
    base = scene()
    good = {
        "scenario_x.parquet": tracks_bytes(base),
        "log_map_archive_x.json": _map_of(base),
    }
    kind = random.integers(4)
    odd = str(random.choice(ODD_TEXTS))
    if kind == 0:
        suffixes = (".parquet", ".json")
        files = {
            odd + suffix: data
            for suffix, data in zip(suffixes, good.values(), strict=True)
        }
    elif kind == 1:
        files = {odd + ".zip": spoiled_bytes(_zipped(good), random)}
    elif kind == 2:
        names = {
            (odd if random.random() < 0.5 else "x") + "/" + name: data
            for name, data in good.items()
        }
        with contextlib.suppress(UnicodeError):
            names = {name.encode().decode(): data for name, data in names.items()}
        files = {"x.zip": _zipped(names)}
    else:
        bomb = {"scenario_x.parquet": b"\0" * int(10 ** random.uniform(3, 8.2))}
        files = {"x.zip": _zipped({**good, **bomb})}
    return lambda: looked_at(scenario_from_upload(files))


def arguments(random: np.random.Generator, folder: Path) -> Action:
    """A command line with odd words."""
    commands: Mapping[str, list[str]] = {
        "warp": [DEMO, "--kind", "smooth-turn", "--power", "3", "--anchor", "focal"],
        "generate": [DEMO, "--samples", "2", "--seed", "1", "--tries", "1"],
        "export": [DEMO, "--to", "av2"],
        "replay": [str(demo_folder(DEMO)), "--base", DEMO],
        "evaluate": ["--data", str(folder), "--samples", "2", "--limit", "1"],
        "synth": ["--num", "0", "--seed", "3", "--workers", "1"],
        "train": ["init", "--data", str(folder), "--devices", "1", "--steps", "1"],
        "model": ["--init", str(folder)],
        "edit": [DEMO, "--port", "0", "--host", "127.0.0.1"],
    }
    command = str(random.choice(list(commands)))
    words = [*commands[command], "--out", str(folder / "out")]
    if command == "generate":
        words += ["--model", "lane-follower"]
    if command in ("synth", "edit", "train", "evaluate"):
        # Without a mistake these would work for long.
        words += ["--no-such-option"] if random.random() < 0.3 else []
    odd = (*ODD_TEXTS, "1e400", "nan", "-inf", str(10**21), "/dev/zero", "--", "--out")
    for _ in range(random.integers(1, 4)):
        at = int(random.integers(len(words) + 1))
        kind = random.integers(3)
        word = str(odd[random.integers(len(odd))])
        if kind == 0:
            words.insert(at, word)
        elif kind == 1 and at < len(words):
            words[at] = word
        elif at < len(words):
            del words[at]
    return lambda: main([command, *words])


def messages(random: np.random.Generator, folder: Path) -> Action:
    """Twenty odd messages on a connection, while another tab works."""
    frames = [odd_frame(random) for _ in range(20)]

    def send() -> None:
        logging.basicConfig(format="%(levelname)s %(message)s", force=True)
        with running_app(folder, DEMO) as app:
            protocols: list[Any] = [f"viser-v{viser.__version__}"]
            address = f"ws://127.0.0.1:{app.server.get_port()}"
            with (
                connected_tab(app) as other,
                connect(address, subprotocols=protocols, max_size=None) as browser,
            ):
                with contextlib.suppress(ConnectionClosed):
                    browser.send(msgspec.msgpack.encode(CAMERA))
                    for frame in frames:
                        browser.send(frame)
                agent = other.session.scenario.focal_id
                other.run(lambda: other.session.select((agent,)))
                assert other.session.selection == (agent,)

    return send


KINDS: Mapping[str, Callable[[np.random.Generator, Path], Action]] = {
    "tracks": tracks,
    "maps": maps,
    "recipes": recipes,
    "journals": journals,
    "models": models,
    "uploads": uploads,
    "arguments": arguments,
    "messages": messages,
}


def bad_input(kind: str, number: int, seed: int, folder: Path) -> Action:
    """An input of a kind; its files go into a folder."""
    random = np.random.default_rng([seed, list(KINDS).index(kind), number])
    return KINDS[kind](random, folder)


def _map_of(scenario: Scenario) -> bytes:
    return map_bytes(scenario.road_map, scenario.origin_city_m)


def _opens(files: Mapping[str, bytes], folder: Path) -> Action:
    for name, data in files.items():
        (folder / name).write_bytes(data)
    return lambda: looked_at(open_scenario(folder))


def _edited(base: Scenario, journal: Journal | None = None) -> EditorSession:
    """A session with edits that hold numbers, arrays and generated traffic."""
    session = EditorSession(base, journal=journal)
    agent = base.focal_id
    session.apply(SetAgentSpeed(agent_ids=(agent,), speed_mps=5.0))
    row, now = session.scenario.agents.row_of[agent], base.current_step
    tracks = session.scenario.agents
    session.apply(
        AdoptTrajectory.of_arrays(
            agent_id=agent,
            position_m=tracks.position_m[row, now:],
            heading_rad=tracks.heading_rad[row, now:],
            velocity_mps=tracks.velocity_mps[row, now:],
        )
    )
    request = GenerationRequest(scenario=session.scenario, agent_ids=(agent,), seed=1)
    traffic = run_to_end(LaneFollower().generate(request))
    session.apply(traffic_command(request, traffic))
    return session


def _spoiled_table(table: pa.Table, random: np.random.Generator) -> pa.Table:
    at = int(random.integers(table.num_columns))
    name = table.column_names[at]
    kind = random.integers(6)
    if kind == 0:
        return table.drop_columns([name])
    if kind == 1:
        rows = random.integers(max(len(table), 1), size=len(table))
        return table.take(pa.array(rows))
    if kind == 2:
        value = ODD_VALUES[random.integers(len(ODD_VALUES))]
        with contextlib.suppress(pa.ArrowException, OverflowError, UnicodeError):
            return table.set_column(at, name, pa.array([value] * len(table)))
        return table.slice(0, 0)
    if kind == 3 and "track_id" in table.column_names:
        ids = table.column_names.index("track_id")
        named = [str(one) for one in table["track_id"].to_pylist()]
        return pa.concat_tables(
            table.set_column(
                ids,
                "track_id",
                pa.array([f"{number}-{one}" if number else one for one in named]),
            )
            for number in range(1 + int(10 ** random.uniform(0, 2.5)))
        )
    if kind == 4 and "num_timestamps" in table.column_names:
        steps = int(10 ** random.uniform(0, 6))
        where = table.column_names.index("num_timestamps")
        return table.set_column(where, "num_timestamps", pa.array([steps] * len(table)))
    values = table[name].to_pylist()
    for _ in range(random.integers(1, 5)):
        row = int(random.integers(max(len(values), 1)))
        if values and isinstance(values[row], (int, float)):
            values[row] = values[row] * float(random.choice([-1, 0, 1e3, 1e9, np.nan]))
        elif values:
            values[row] = str(random.choice(ODD_TEXTS))
    with contextlib.suppress(pa.ArrowException, OverflowError, UnicodeError):
        return table.set_column(at, name, pa.array(values))
    return table.drop_columns([name])


def _zipped(files: Mapping[str, bytes]) -> bytes:
    sink = io.BytesIO()
    with zipfile.ZipFile(sink, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            safe = name.encode("utf-8", "replace").decode()
            archive.writestr(zipfile.ZipInfo(safe or "x"), data)
    return sink.getvalue()


def odd_frame(random: np.random.Generator) -> bytes | str:
    """A frame that viser's browser would not send."""
    kind = random.integers(4)
    if kind == 0:
        return random.bytes(int(random.integers(200)))
    if kind == 1:
        return "text"
    if kind == 2:
        return spoiled_bytes(msgspec.msgpack.encode(CAMERA), random)
    messages: tuple[dict[str, Any], ...] = (
        CAMERA,
        {"type": "GuiUpdateMessage", "uuid": "x", "updates": {"value": 1}},
        {"type": "LocalStorageResponseMessage", "request_uuid": "x", "value": "[]"},
        {
            "type": "ScenePointerMessage",
            "event_type": "click",
            "ray_origin": [0.0, 0.0, 1.0],
            "ray_direction": [0.0, 0.0, -1.0],
            "screen_pos": [[0.5, 0.5]],
        },
        {
            "type": "FileTransferStartUpload",
            "source_component_uuid": "x",
            "transfer_uuid": "y",
            "filename": "z",
            "mime_type": "z",
            "part_count": 1,
            "size_bytes": 10,
        },
    )
    chosen = messages[random.integers(len(messages))]
    spoiled = spoiled_json(chosen, random)
    try:
        return msgspec.msgpack.encode(spoiled)
    except (TypeError, ValueError, OverflowError):
        return b"\xc1"
