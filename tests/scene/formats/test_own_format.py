"""A format of one's own: the example, joined by an entry point as a package does it."""

import gzip
import shutil
import sys
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import numpy as np
import pytest

from pd_editor.base.errors import ExportError, FormatError, InputError
from pd_editor.editor.scenario_store import open_base, open_scenario
from pd_editor.experiments.evaluation.evaluation import scenes_of
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.formats import dataset, registry
from pd_editor.scene.formats.dataset import CardFilter, DatasetIndex
from pd_editor.scene.formats.file_scene import FileScene, FileTrack
from pd_editor.scene.formats.recorded_map import CenterLane, lanes_of
from pd_editor.scene.formats.registry import (
    ENTRY_POINTS,
    REFERENCES,
    add_formats,
    formats,
    writer,
)
from tests.cli.shell import Shell, files_of

BROKEN = """
from dataclasses import replace
from pathlib import Path
from examples.csv_format import FORMAT
from pd_editor.base.errors import FormatError
def fails(what):
    error = {"key": KeyError("speed"), "exit": SystemExit(0), "own": FormatError("too old")}
    def failing(_): raise error[what]
    return failing
knows = lambda path: path.suffix == ".mine" or path.name == "my_street"
FORMAT = replace(FORMAT, name="broken", title="Mine", endings=(".mine",), recognises=knows)
"""


@pytest.fixture
def joined(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest):
    """Formats with one of another package."""
    point = EntryPoint(
        name="csv-folder",
        value=getattr(request, "param", "examples.csv_format:FORMAT"),
        group=ENTRY_POINTS,
    )
    monkeypatch.setattr(registry, "entry_points", lambda **_: EntryPoints([point]))
    formats.cache_clear()
    yield
    formats.cache_clear()


@pytest.fixture
def broken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Joins a format of which a field is replaced."""

    def joins(change: str) -> None:
        (tmp_path / "my_broken_format.py").write_text(
            f"{BROKEN}FORMAT = replace(FORMAT, {change})\n"
        )
        monkeypatch.syspath_prepend(str(tmp_path))
        point = EntryPoint("broken", "my_broken_format:FORMAT", ENTRY_POINTS)
        monkeypatch.setattr(registry, "entry_points", lambda **_: EntryPoints([point]))
        formats.cache_clear()

    yield joins
    sys.modules.pop("my_broken_format", None)
    formats.cache_clear()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two lanes in a row, and a car that drives along both."""
    path = tmp_path / "data" / "my_street"
    path.mkdir(parents=True)
    (path / "lanes.csv").write_text(
        "lane,width_m,next,x_m,y_m\na,4,b,0,0\na,4,b,60,0\nb,3,gone,60,0\nb,3,gone,120,10\n"
        "c,3,,0,3.5\nc,3,,60,3.5\n"
    )
    rows = [f"car,vehicle,{n / 5 - 4},{10 * n / 5},0,0" for n in range(40)]
    (path / "tracks.csv").write_text(
        "\n".join(["agent,kind,time_s,x_m,y_m,heading_rad", *rows])
    )
    return path


@pytest.mark.usefixtures("joined")
def test_a_folder_opens_like_any_scene(folder: Path):
    scenario = open_scenario(folder)
    assert scenario.scenario_id == "my_street"
    first, second, _ = scenario.road_map.lanes
    assert first.successors == (2,)
    widths = [np.ptp(np.stack([one.left, one.right])[:, 0, 1]) for one in (first, second)]  # fmt: skip
    np.testing.assert_allclose(widths, [4.0, 3.0], atol=0.1)
    agents = scenario.agents
    assert agents.ids == ("car",)
    known = agents.is_valid[0]
    # Five states a second become ten.
    assert known.sum() == 79
    speed = agents.speed_mps()[0, known]
    np.testing.assert_allclose(speed, 10.0, atol=1e-9)


@pytest.mark.usefixtures("joined")
def test_lanes_that_others_name_and_that_are_not_there_are_counted(folder: Path):
    """Such a successor was dropped without a word."""
    scenario = open_scenario(folder)
    second = scenario.road_map.lanes[1]
    assert not set(second.successors) & set(scenario.road_map.lane_of)
    assert "1 link names a lane" in " ".join(scenario.provenance.notes)


@pytest.mark.usefixtures("joined")
def test_the_current_step_is_after_a_past_unless_it_is_told(folder: Path):
    from dataclasses import replace

    from pd_editor.scene.agent_kind import AgentKind
    from pd_editor.scene.formats.file_scene import FileScene, FileTrack

    def opened(seconds: float, **more):
        time = np.arange(0, seconds, 0.1) + 7.0
        place = np.stack([10 * time, np.zeros_like(time)], axis=-1)
        track = FileTrack(track_id="a", kind=AgentKind.VEHICLE, size_m=None, time_s=time, position_m=place, heading_rad=np.zeros_like(time))  # fmt: skip
        lane = CenterLane(key="a", line=np.array([[0.0, 0.0], [300.0, 0.0]]))
        scene = FileScene(
            path=folder, name="x", lanes=lanes_of([lane]), tracks=(track,)
        )
        scenario = replace(scene, **more).scenario(b"")
        return int(scenario.agents.is_valid[0, : scenario.current_step].sum())

    assert (opened(11.0), opened(4.05), opened(11.0, current_s=8.0)) == (49, 20, 10)
    # Models sample 6 s, all that is left of 11 s from the first state to the last.
    assert (opened(11.1), opened(11.2)) == (50, 49)


@pytest.mark.usefixtures("joined")
@pytest.mark.parametrize(
    ("table", "row", "told"),
    [
        ("tracks.csv", "car,vehicle,0,a,0,0", "ValueError.*in csv_format.py:"),
        ("tracks.csv", "car,boat,0,0,0,0", "ValueError.*boat"),
        (
            "lanes.csv",
            "a,4,b",
            "lane 'a' has a line of shape|CSV folder cannot be read",
        ),
        ("lanes.csv", "a,4,b,nan,0\na,4,b,10,0", "lane 'a' has points without a place"),
        ("lanes.csv", "a,4,b,0,inf\na,4,b,10,0", "lane 'a' has points without a place"),
        ("lanes.csv", "a,nan,b,0,0\na,nan,b,10,0", "lane 'a' has no width"),
        ("lanes.csv", "a,-3,b,0,0\na,-3,b,10,0", "lane 'a' is -1.5 m wide to the left"),
        (
            "tracks.csv",
            "car,vehicle,-5,0,0,0\ncar,vehicle,-4,1,0,0",
            "its current step is at 0 s; expected a time of its tracks, -5 to -4 s",
        ),
    ],
)
def test_a_broken_file_is_one_sentence(folder: Path, table: str, row: str, told: str):
    """Points that are not numbers were a traceback of a library."""
    (folder / table).write_text(f"a header\n{row}\n")
    with pytest.raises(FormatError, match=f"my_street: .*({told})"):
        open_scenario(folder)


@pytest.mark.parametrize("key", ["a", ""])
def test_lanes_of_one_name_are_refused(key: str):
    line = np.array([[0.0, 0.0], [9.0, 0.0]])
    with pytest.raises(FormatError, match="twice"):
        lanes_of([CenterLane(key=key, line=line), CenterLane(key=key, line=line)])


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ("read=fails('key')", r"my_street: Mine cannot be read \(KeyError: 'speed' in my_broken_format.py:8\)"),
        ("read=fails('exit')", "my_street: Mine cannot be read .SystemExit"),
        ("read=fails('own')", "my_street: too old"),
        ("read=lambda path: 5", "got a int; expected a Scenario"),
        ("recognises=fails('key')", "found no track files"),
    ],
)  # fmt: skip
def test_whatever_a_format_raises_is_one_sentence(
    folder: Path, broken, change: str, told: str, caplog
):
    broken(change)
    with pytest.raises(InputError, match=told):
        open_scenario(folder)
    # Nobody else's scene suffers.
    assert open_scenario("roundabout").scenario_id == "roundabout"
    if "recognises" in change:
        assert "did not say whether it knows a file (KeyError" in caplog.text


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ("write=fails('key')", "cannot be written as Mine .KeyError: 'speed' in my_br"),
        ("write=lambda scenario: {}", "got a dict; expected a WrittenScene"),
        ("write=lambda s, own=FORMAT.write: replace(own(s), files={'a': 'b'})", "Mine .*'a'"),
    ],
)  # fmt: skip
def test_whatever_a_writer_raises_is_one_sentence(broken, change: str, told: str):
    scenario = open_scenario("roundabout")
    broken(change)
    with pytest.raises(ExportError, match=told):
        writer("broken").write(scenario)


@pytest.mark.parametrize(
    "joined",
    ["examples.csv_format:read", "examples.none:A", f"{registry.__name__}:OPENDRIVE"],
    indirect=True,
)
@pytest.mark.usefixtures("joined")
def test_a_format_that_cannot_be_loaded_is_left_out_and_told(caplog):
    """It stopped exports of demos."""
    assert writer("av2").write(open_scenario("roundabout")).files
    assert "The format 'csv-folder'" in caplog.text
    assert "cannot be loaded" in caplog.text
    assert "csv-folder" not in formats()


@pytest.fixture
def shell(capsys: pytest.CaptureFixture[str]) -> Shell:
    return Shell(capsys)


@pytest.mark.usefixtures("joined")
def test_commands_take_folders_of_a_format(shell: Shell, folder: Path, tmp_path: Path):
    """They looked for Argoverse 2 files in them, and found none."""
    shutil.copytree(folder, folder.parent / "town" / "other.street")
    out = tmp_path / "out"
    for where, names in (
        (folder, ["my_street"]),
        (folder.parent, ["my_street", "other-street"]),
        (folder.parent / "*street", ["my_street"]),
    ):
        result = shell.run("convert", where, "--to", "csv-folder", "--out", out / "c", "--overwrite")  # fmt: skip
        assert result.code == 0, result.err
        assert "1 link names a lane that the map lacks." in result.out
        found = {
            Path(one).name
            for one in result.lines
            if ".txt" not in one and " link names " not in one
        }
        assert {one.replace(".", "-") for one in found} == set(names)
    assert (out / "c" / "my_street" / "losses.txt").exists()
    again, first = open_scenario(out / "c" / "my_street"), open_scenario(folder)
    np.testing.assert_allclose(
        again.agents.position_m + again.origin_city_m,
        first.agents.position_m + first.origin_city_m,
        atol=1e-9,
    )
    assert again.current_step == first.current_step
    warped = shell.run("warp", folder, "--kind", "smooth-turn", "--power", 3, "--out", out / "w")  # fmt: skip
    assert warped.code == 0, warped.err
    made = shell.run("generate", folder.parent, "--model", "lane-follower", "--out", out / "g")  # fmt: skip
    assert (made.code, len(list((out / "g").iterdir()))) == (0, 2), made.err
    whole = shell.run("export", "roundabout", "--format", "csv-folder", "--out", out / "e")  # fmt: skip
    assert whole.code == 0, whole.err
    replayed = shell.run("replay", out / "c", "--out", out / "r")
    assert replayed.code == 0, replayed.err


@pytest.mark.usefixtures("joined")
def test_folders_of_a_format_are_scenes_of_a_dataset(folder: Path):
    shutil.copytree(folder, folder.parent / "town" / "other.street")
    (folder.parent / "town" / "other.street" / "page.xml").write_text("<html/>")
    cards = list(DatasetIndex(folder.parent).filter())
    assert [(one.scenario_id, one.split, one.num_agents) for one in cards] == [
        ("my_street", "", 1),
        ("other.street", "town", 1),
    ]
    assert [one.scenario_id for one in DatasetIndex(folder).filter()] == ["my_street"]
    assert len(scenes_of((folder.parent,)).scenes) == 2


@pytest.mark.usefixtures("joined")
@pytest.mark.parametrize("fault", ["row", "bug"])
def test_a_scene_that_cannot_be_read_counts_as_seen(
    folder: Path, fault: str, monkeypatch: pytest.MonkeyPatch, caplog
):
    """It was read again twice a second, and those after it never."""
    shutil.copytree(folder, folder.parent / "b_street")
    read = registry.read_scene

    def failing(path: Path):
        if fault == "bug" and path.name == "b_street":
            raise KeyError("speed")
        return read(path)

    monkeypatch.setattr(dataset, "read_scene", failing)
    if fault == "row":
        (folder.parent / "b_street" / "tracks.csv").write_text("x\ncar,vehicle,0\n")
    index = DatasetIndex(folder.parent)
    position, names = 0, []
    for _ in range(10):
        step = index.search(CardFilter(), position, 1)
        position, names = step.next_start, names + [one.scenario_id for one in step.cards]  # fmt: skip
        if step.is_complete:
            break
    assert (names, step.is_complete) == (["my_street"], True)
    (reason,) = index.failures()
    assert reason.startswith("b_street: ")
    assert ("KeyError" if fault == "bug" else "ValueError") in reason
    assert len(scenes_of((folder.parent,)).scenes) == 1
    assert "1 scenes in" in caplog.text
    assert reason in caplog.text


def track(**changes: object) -> FileTrack:
    """An agent that drives to the north, and tells no heading."""
    values: dict[str, object] = {
        "track_id": "a",
        "kind": AgentKind.VEHICLE,
        "size_m": None,
        "time_s": np.arange(3) / 10,
        "position_m": np.array([(0.0, 0.0), (0.0, 1.0), (0.0, 2.0)]),
        "heading_rad": np.full(3, np.nan),
    }
    return FileTrack(**{**values, **changes})  # type: ignore[arg-type]


def test_headings_that_are_not_told_are_those_of_the_motion():
    np.testing.assert_allclose(track().heading_rad, np.pi / 2)
    told = track(heading_rad=np.array([0.0, np.nan, np.nan])).heading_rad
    np.testing.assert_allclose(told, [0.0, np.pi / 2, np.pi / 2])


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        (
            {
                "time_s": np.zeros(0),
                "position_m": np.zeros((0, 2)),
                "heading_rad": np.zeros(0),
            },
            "has 0 times, 0 positions and 0 headings",
        ),
        ({"time_s": 1e9 + np.arange(3) / 10}, "count times from the recording's begin"),
    ],
)
def test_tracks_that_do_not_fit_are_told(changes: dict[str, object], told: str):
    line = np.array([(0.0, -50.0), (0.0, 50.0)])
    lanes = lanes_of([CenterLane(key="1", line=line)])
    scene = FileScene(path=Path("x"), name="x", lanes=lanes, tracks=(track(**changes),))
    with pytest.raises(FormatError, match=told):
        scene.scenario(b"")


@pytest.mark.usefixtures("joined")
def test_a_part_of_a_long_recording_is_opened(
    shell: Shell, folder: Path, tmp_path: Path
):
    """There was no way to open one."""
    rows = [f"car,vehicle,{n / 5},{n / 20},0,0" for n in range(2000)]
    rows += [f"late,vehicle,{n / 10 + 395:.1f},{n / 10},3.5,0" for n in range(30)]
    (folder / "tracks.csv").write_text("agent,kind,time_s,x_m,y_m,heading_rad\n" + "\n".join(rows))  # fmt: skip
    with pytest.raises(FormatError, match=r"lasts 400 s; at most 100 s .* --current S"):
        open_scenario(folder)
    part = open_scenario(folder, current_s=300.0, until_s=6.0)
    agents, axis = part.agents, part.time_axis
    assert (agents.ids, axis.num_steps, axis.current_step) == (("car",), 110, 49)
    assert agents.is_valid.all()
    place = agents.position_m[0] + part.origin_city_m
    np.testing.assert_allclose(place[:, 0], np.arange(2950, 3060) / 40, atol=1e-9)
    assert open_base(part.reference).reference == part.reference
    other = open_scenario(folder, current_s=396.0, until_s=2.0)
    assert (set(other.agents.ids), other.time_axis.num_steps) == ({"car", "late"}, 70)
    assert other.reference.content_sha256 != part.reference.content_sha256
    with pytest.raises(FormatError, match="lasts 400 s"):
        open_scenario(folder, current_s=50.0)
    with pytest.raises(InputError, match="expected a current step"):
        open_scenario(folder, current_s=500.0)
    square = {"around": (74.0, 0.0), "radius_m": 10.0}
    place = open_scenario(folder, current_s=300.0, until_s=6.0, **square)
    assert place.agents.ids == ("car",)
    options = ("--model", "lane-follower", "--current", 300, "--until", 6)
    made = shell.run("generate", folder, *options, "--out", tmp_path / "g")
    assert made.code == 0, made.err
    again = shell.run("replay", made.lines[0], "--out", tmp_path / "r")
    assert again.code == 0, again.err
    assert files_of(Path(again.lines[0])) == files_of(Path(made.lines[0]))


@pytest.mark.parametrize("kind", ["gzipped", "misnamed"])
def test_gzipped_files_of_a_format_open_as_they_are(broken, tmp_path: Path, kind: str):
    """Those of other formats did; own formats got the packed bytes."""
    broken(
        "read=lambda path, own=FORMAT.read: own(Path(path.read_text())), recognises="
        "lambda path: path.suffix == '.mine' and path.read_text().startswith('/')"
    )
    street = tmp_path / "street"
    street.mkdir()
    (street / "lanes.csv").write_text(
        "lane,width_m,next,x_m,y_m\na,4,,0,0\na,4,,60,0\n"
    )
    data = str(street).encode()
    path = tmp_path / "One.mine.gz"
    path.write_bytes(gzip.compress(data) if kind == "gzipped" else data)
    scene = open_scenario(path)
    assert scene.provenance.source == str(path)
    assert open_base(scene.reference).reference == scene.reference
    path.write_bytes(gzip.compress(f"/{tmp_path}/none".encode()))
    with pytest.raises(FormatError, match=rf"^{path}: .*has no lane"):
        open_scenario(path)


@pytest.mark.parametrize("asks_for_it", [False, True])
def test_what_lies_beside_a_gzipped_file_is_found(
    broken, tmp_path: Path, asks_for_it: bool
):
    """Readers saw the file alone, in a folder of its own."""
    knows = "(path.parent / 'more' / 'lanes.csv').exists()" if asks_for_it else "True"
    broken(
        "read=lambda path, own=FORMAT.read: own(path.parent / path.read_text()), recognises="
        f"lambda path: path.suffix == '.mine' and {knows}"
    )
    (tmp_path / "more").mkdir()
    lanes = tmp_path / "more" / "lanes.csv"
    lanes.write_text("lane,width_m,next,x_m,y_m\na,4,,0,0\na,4,,60,0\n")
    path = tmp_path / "one.mine.gz"
    path.write_bytes(gzip.compress(b"more"))
    # What it is unpacked from does not hide it.
    (tmp_path / "one.mine").write_text("less")
    assert len(open_scenario(path).road_map.lanes) == 1
    lanes.write_text("lane,width_m,next,x_m,y_m\n")
    with pytest.raises(FormatError, match=f"^{path}: .*{lanes.parent}.* has no lane"):
        open_scenario(path)
    assert lanes.exists()


@pytest.fixture
def nothing_added(monkeypatch: pytest.MonkeyPatch):
    """What a test adds is forgotten."""
    monkeypatch.setenv(REFERENCES, "")
    yield
    formats.cache_clear()


@pytest.mark.usefixtures("nothing_added")
def test_a_format_is_named_without_being_installed(
    shell: Shell, folder: Path, tmp_path: Path
):
    """Generators and policies were, formats had to be packages."""
    named = ("--formats", "examples.csv_format:FORMAT")
    with pytest.raises(InputError):
        open_scenario(folder)
    shutil.copytree(folder, folder.parent / "other_street")
    # Other processes know it, too.
    options = ("--to", "csv-folder", "--out", tmp_path / "out", "--workers", 2)
    made = shell.run("convert", folder.parent, *named, *options)
    assert made.code == 0, made.err
    assert len(list((tmp_path / "out").iterdir())) == 2
    again = shell.run(*named, "evaluate", "--data", made.lines[0], "--out", tmp_path / "e", "--methods", "ground-truth")  # fmt: skip
    assert (again.code, again.err) == (0, "")
    assert open_scenario(folder).scenario_id == "my_street"


@pytest.mark.usefixtures("nothing_added")
@pytest.mark.parametrize(
    ("reference", "told"),
    [
        ("nowhere:FORMAT", "nowhere:FORMAT: cannot be imported (ModuleNotFoundError"),
        ("examples.csv_format:FORMATS", "has no attribute 'FORMATS'"),
        ("math:pi", "math:pi cannot be loaded (TypeError: got a float; expected a Sc"),
        (
            "examples/csv_format.py",
            "'examples/csv_format.py' names no format; expected",
        ),
        ("pd_editor.scene.formats.sumo:SUMO", "there is a format 'sumo' already"),
    ],
)
def test_what_is_no_format_is_refused(reference: str, told: str, shell: Shell):
    assert told in shell.refused("threats", "queue", "--formats", reference)
    with pytest.raises(InputError):
        add_formats(reference)
    assert "expected package.module:attribute" in shell.refused("find", "--formats")
