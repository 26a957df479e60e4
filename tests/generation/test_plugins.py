import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.base.errors import GenerationError
from pd_editor.cli.main import main
from pd_editor.generation import plugins as plugins_module
from pd_editor.generation.generators import catalogue_with, make_generator
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.generation import GenerationRequest, run_to_end
from tests.builders import scenario_with, straight_drivers
from tests.cli.shell import ROOT

DRIFT = "examples.drift_generator:DriftGenerator"

DRIVERS = [(0, 0, 0, 10), (30, 0, 0, 5), (0, 3.5, 0, 0.5)]

FAULTY = """
import numpy as np
from dataclasses import replace
from examples.drift_generator import DriftGenerator
from pd_editor.scene.prediction import Prediction

NUMBER = 3

class Raises:
    name = "raises"
    def generate(self, request):
        raise KeyError("no such lane")

class Nothing:
    name = "nothing"
    def generate(self, request):
        yield from ()

class Forgets:
    name = "forgets"
    def generate(self, request):
        pass

class Fewer:
    name = "fewer"
    def generate(self, request):
        return (yield from DriftGenerator().generate(replace(request, num_samples=1)))

class Moves:
    name = "moves"
    def generate(self, request):
        traffic = yield from DriftGenerator().generate(request)
        samples = []
        for one in traffic.samples:
            position = one.position_m.copy()
            position[1, 0] += 0.5
            samples.append(replace(one, position_m=position))
        return replace(traffic, samples=tuple(samples))

class Holes:
    name = "holes"
    def generate(self, request):
        traffic = yield from DriftGenerator().generate(request)
        position = traffic.samples[0].position_m.copy()
        position[2, 7, 0] = np.nan
        return replace(traffic, samples=(replace(traffic.samples[0], position_m=position),))

class Obeys(DriftGenerator):
    # It claims what it likes; its samples ignore all guidance.
    supports = ("guidance",)
    def generate(self, request):
        from pd_editor.scene.generation import GuidanceReport
        traffic = yield from super().generate(request)
        return replace(traffic, guidance=(GuidanceReport(),) * len(traffic.samples))

class Typo(DriftGenerator):
    supports = ("guidence",)

class Deep:
    name = "deep"
    def generate(self, request):
        np.stack([np.zeros(2), np.zeros(3)])

class Needs:
    name = "needs"
    def __init__(self, weights):
        self.weights = weights
    def predict(self, request): ...

class Unborn:
    name = "unborn"
    def __init__(self):
        raise OSError("weights.bin is missing")
    def predict(self, request): ...

class AtOnce:
    name = "at-once"
    def generate(self, request):
        from pd_editor.scene.generation import run_to_end
        return run_to_end(DriftGenerator().generate(request))

class Shape:
    name = "shape"
    def predict(self, request):
        return Prediction(position_m=np.zeros((1, 2, 3, 2)), probability=np.ones((1, 2)))

class NotANumber:
    name = "nan"
    def predict(self, request):
        shape = (len(request.agents.ids), 1, request.num_steps, 2)
        return Prediction(position_m=np.full(shape, np.nan), probability=np.ones(shape[:2]))

class Pair:
    name = "pair"
    def predict(self, request):
        return np.zeros((1, 1, 60, 2)), np.ones((1, 1))

class Negative:
    name = "negative"
    def predict(self, request):
        shape = (len(request.agents.ids), 1, request.num_steps, 2)
        return Prediction(position_m=np.zeros(shape), probability=-np.ones(shape[:2]))
"""


@pytest.fixture
def faulty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    (tmp_path / "my_faulty_plugin.py").write_text(FAULTY)
    (tmp_path / "my_unimportable_plugin.py").write_text("\nimport no_such_library\n")
    (tmp_path / "my_misspelt_plugin.py").write_text("\n\nclass Generator\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield "my_faulty_plugin"
    sys.modules.pop("my_faulty_plugin", None)


def request(num_samples: int = 2) -> GenerationRequest:
    scenario = scenario_with(straight_drivers(DRIVERS))
    return GenerationRequest(
        scenario=scenario, agent_ids=scenario.agents.ids, num_samples=num_samples
    )


def test_a_class_a_function_and_an_instance_are_taken():
    for reference in (DRIFT, "examples.constant_velocity:Predictor"):
        traffic = run_to_end(make_generator(reference).generate(request()))
        assert len(traffic.samples) == 2
        assert traffic.generator == make_generator(reference).name


def test_modules_of_the_current_folder_are_found(faulty: str):
    traffic = run_to_end(make_generator(f"{faulty}:AtOnce").generate(request()))
    assert traffic.generator == "drift"


@pytest.mark.parametrize(
    ("reference", "sentence"),
    [
        ("no_such_package.thing:Generator", "cannot be imported .*No module named"),
        ("my_unimportable_plugin:Generator", "No module named 'no_such_library'"),
        (
            "my_faulty_plugin:Raise",
            "no attribute 'Raise'; the nearest is Raises",
        ),
        # Places are lines of the user's file, not of what imports or calls it.
        (
            "my_unimportable_plugin:Generator",
            r"'no_such_library' in my_unimportable_plugin.py:2\)",
        ),
        (
            "my_misspelt_plugin:Generator",
            r"\(SyntaxError: expected ':' in my_misspelt_plugin.py:3\)",
        ),
        ("my_faulty_plugin:Needs", r"missing 1 required .*: 'weights'\)\.$"),
        (
            "my_faulty_plugin:Typo",
            "supports 'guidence', which is unknown; the nearest is guidance",
        ),
        ("my_faulty_plugin:NUMBER", "is a int; expected an object with a name and"),
        ("my_faulty_plugin:Unborn", "OSError: weights.bin is missing in my_faulty_plu"),
    ],
)
def test_what_cannot_be_loaded_is_told_in_one_sentence(
    faulty: str, reference: str, sentence: str
):
    with pytest.raises(GenerationError, match=sentence) as caught:
        make_generator(reference)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        (
            "Raises",
            r"my_faulty_plugin:Raises failed \(KeyError: 'no such lane' in my_f",
        ),
        ("Nothing", "returned a NoneType; expected GeneratedTraffic"),
        ("Forgets", "Forgets returned a NoneType; expected GeneratedTraffic"),
        ("Fewer", "1 samples came back, 2 were asked for"),
        ("Shape", r"position_m with the shape \(1, 2, 3, 2\); expected \(A, K, F, 2\)"),
        (
            "NotANumber",
            "NotANumber: The generated position_m of agent .*, trajectory 0, step 0 is nan",
        ),
        (
            "Holes",
            "Holes: The generated position_m of agent 102, step 7 is nan; expected",
        ),
        ("Deep", r"Deep failed \(ValueError: .* in my_faulty_plugin.py:\d+\)"),
        (
            "Moves",
            r"Moves: Sample 0 moves agent 101 by 0.71 m at the current step; exp",
        ),
        ("Negative", "a probability below 0; expected 0 or more"),
        ("Pair", "The predictor pair returned a tuple; expected a Prediction"),
    ],
)
def test_a_wrong_answer_is_told_in_one_sentence(faulty: str, name: str, sentence: str):
    generator = make_generator(f"{faulty}:{name}")
    with pytest.raises(GenerationError, match=sentence):
        run_to_end(generator.generate(request()))


def test_a_folder_makes_its_generator(tmp_path: Path):
    folder = tmp_path / "my-network"
    folder.mkdir()
    (folder / "weights.txt").write_text("7")
    (folder / "generator.py").write_text(
        "from examples.drift_generator import DriftGenerator\n"
        "def make_generator(folder):\n"
        "    made = DriftGenerator()\n"
        "    made.name = 'network-' + (folder / 'weights.txt').read_text()\n"
        "    return made\n"
    )
    offer = catalogue_with([folder]).offers["my-network"]
    assert offer.make().name == make_generator(str(folder)).name == "network-7"
    (folder / "generator.py").write_text("make = 1\n")
    with pytest.raises(GenerationError, match=r"has no function make_generator\(folde"):
        make_generator(str(folder))


def test_entry_points_of_installed_packages_come_last(monkeypatch: pytest.MonkeyPatch):
    entry_point = EntryPoint("my-drift", DRIFT, plugins_module.ENTRY_POINTS)
    plugins_module.installed_plugins.cache_clear()
    monkeypatch.setattr(plugins_module, "entry_points", lambda **_: [entry_point])
    try:
        offers = catalogue_with(()).offers
        assert list(offers)[-1] == "my-drift"
        assert offers["my-drift"].origin.startswith(DRIFT)
        assert make_generator("my-drift").name == "drift"
    finally:
        plugins_module.installed_plugins.cache_clear()


def test_a_predictor_samples_no_states():
    asked = replace(request(), resampled_state_ids=request().agent_ids)
    generator = make_generator("examples.constant_velocity:Predictor")
    with pytest.raises(GenerationError, match="samples no initial states; keep"):
        run_to_end(generator.generate(asked))


def test_a_generator_does_what_it_declares_only(faulty: str):
    resampled = replace(request(), resampled_state_ids=request().agent_ids)
    added = replace(request(), num_new_agents={AgentKind.VEHICLE: 1})
    generator = make_generator(f"{faulty}:AtOnce")
    for asked, told in ((resampled, "samples no initial"), (added, "adds no agents")):
        with pytest.raises(GenerationError, match=told):
            run_to_end(generator.generate(asked))


def test_guidance_is_judged_by_us_and_told_where_it_has_no_effect(faulty: str):
    goal = GoalPoint(agent_id=request().agent_ids[0], point_m=(500.0, 500.0))
    asked = replace(request(), guidance=(goal,))
    deaf = run_to_end(make_generator(DRIFT).generate(asked))
    assert not deaf.guidance
    assert deaf.notes == ("drift takes no guidance: the guidance terms had no effect.",)
    boasts = run_to_end(make_generator(f"{faulty}:Obeys").generate(asked))
    assert [len(one.outcomes) for one in boasts.guidance] == [1, 1]
    assert not any(one.outcomes[0].is_obeyed for one in boasts.guidance)


def test_broken_plugins_are_listed_with_the_reason_and_others_say_what_they_can(
    faulty: str, tmp_path: Path
):
    folder = tmp_path / "broken-network"
    folder.mkdir()
    (folder / "generator.py").write_text("import no_such_library\n")
    found = catalogue_with([f"{faulty}:Obeys", f"{faulty}:Unborn", folder])
    assert found.offers[f"{faulty}:Obeys"].supports == {"guidance"}
    told = {one.name: one.reason for one in found.unusable}
    assert told.keys() == {f"{faulty}:Unborn", "broken-network"}
    assert "OSError: weights.bin is missing" in told[f"{faulty}:Unborn"]
    assert "no_such_library" in told["broken-network"]
    assert not told.keys() & found.offers.keys()


def test_samples_are_the_modes_by_probability_and_begin_at_the_current_state():
    asked = request(num_samples=3)
    generator = make_generator("examples.constant_velocity:Predictor")
    first, second, third = run_to_end(generator.generate(asked)).samples
    agents, now = asked.scenario.agents, asked.scenario.current_step
    for sample in (first, second, third):
        np.testing.assert_array_equal(
            sample.position_m[:, 0], agents.position_m[:, now]
        )
        np.testing.assert_array_equal(
            sample.heading_rad[:, 0], agents.heading_rad[:, now]
        )
    duration_s = asked.scenario.time_axis.times_s()[-1]
    straight = agents.position_m[:, now] + duration_s * agents.velocity_mps[:, now]
    np.testing.assert_allclose(first.position_m[:, -1], straight)
    moved = np.linalg.norm(second.position_m[:, -1] - agents.position_m[:, now], axis=1)
    speed = agents.speed_mps()[:, now]
    np.testing.assert_allclose(moved, speed**2 / 6.0, atol=1e-6)
    np.testing.assert_array_equal(third.position_m, first.position_m)


HOSTILE = """
import os, signal, sys, threading
from dataclasses import replace
import numpy as np
from examples.drift_generator import DriftGenerator
from pd_editor.scene.generation import GenerationProgress, run_to_end

class Bad(Exception):
    def __str__(self):
        raise SystemExit(0)

class Base:
    name = "base"
    def generate(self, request):
        yield GenerationProgress(fraction=0.5, message="half")
        self.act(request)
        return (yield from DriftGenerator().generate(request))
    def act(self, request):
        raise NotImplementedError

def acting(name, code):
    space = dict(globals())
    exec(f"def act(self, request):\\n    {code}", space)
    globals()[name] = type(name, (Base,), {"act": space["act"]})

for name, code in {
    "Exits": "sys.exit(0)",
    "ExitsWithout": "raise SystemExit",
    "Leaves": "os._exit(0)",
    "Becomes": "os.execv('/bin/true', ['true'])",
    "BecomesByPath": "os.execlp('true', 'true')",
    "Interrupts": "raise KeyboardInterrupt",
    "Stops": "raise GeneratorExit",
    "Lowest": "raise BaseException('low')",
    "Unreadable": "raise Bad()",
    "Controls": "raise ValueError(chr(27) + '[2J\\\\n' * 50)",
    "Surrogate": "raise ValueError(chr(0xdcff))",
    "Recurses": "self.act(request)",
}.items():
    acting(name, code)

def answering(name, **changes):
    def generate(self, request):
        traffic = run_to_end(DriftGenerator().generate(request))
        sample = traffic.samples[0]
        own = {k: v(sample) for k, v in changes.items() if hasattr(sample, k)}
        if own:
            for field, value in own.items():
                object.__setattr__(sample, field, value)
            return traffic
        return replace(traffic, **{k: v(sample) for k, v in changes.items()})
    globals()[name] = type(name, (Base,), {"generate": generate})

answering("NoSamples", samples=lambda s: None)
answering("WrongSamples", samples=lambda s: (s, None))
answering("NumberNotes", notes=lambda s: (5, None))
answering("TextSeed", seed=lambda s: "no")
answering("NoSeconds", elapsed_s=lambda s: "soon")
answering("Ghosts", slowed_ids=lambda s: (("ghost",),))
answering("FewSlowed", slowed_ids=lambda s: ((), ()))
answering("Lists", position_m=lambda s: [1, 2])
answering("Complex", position_m=lambda s: s.position_m.astype(complex))
answering("Texts", heading_rad=lambda s: s.heading_rad.astype(str))
answering("Objects", velocity_mps=lambda s: s.velocity_mps.astype(object))
answering("Nothing", size_m=lambda s: None)
answering("NumberIds", ids=lambda s: tuple(range(len(s.ids))))
answering("TextKinds", kinds=lambda s: ("vehicle",) * len(s.ids))
answering("TextActivity", activity=lambda s: ("x",) * len(s.ids))
answering("OneActivity", activity=lambda s: (1,))

def yielding(name, *values):
    def generate(self, request):
        yield from values
        return run_to_end(DriftGenerator().generate(request))
    globals()[name] = type(name, (Base,), {"generate": generate})

yielding("YieldsNumber", 5)
yielding("YieldsNan", GenerationProgress(fraction=float("nan"), message=""))
yielding("YieldsMuch", GenerationProgress(fraction=1e9, message=""))
yielding("YieldsNone", GenerationProgress.__new__(GenerationProgress))

class Numeric(Base):
    name = 5
class Lines(Base):
    name = "a\\nb"
class Long(Base):
    name = "x" * 5000
class Nameless(Base):
    @property
    def name(self):
        raise SystemExit(0)
class Fives(Base):
    supports = 5
class Nones(Base):
    supports = ("states", None)
class Raising(Base):
    @property
    def supports(self):
        raise KeyboardInterrupt
class Anything:
    def __getattr__(self, name):
        raise SystemExit(0)
class Made(Base):
    def __init__(self):
        os._exit(0)
"""
LOADING = [
    "Numeric",
    "Lines",
    "Long",
    "Nameless",
    "Fives",
    "Nones",
    "Raising",
    "Anything",
    "Made",
]
RUNNING = [
    "Exits",
    "ExitsWithout",
    "Leaves",
    "Becomes",
    "BecomesByPath",
    "Interrupts",
    "Stops",
    "Lowest",
    "Unreadable",
    "Controls",
    "Surrogate",
    "Recurses",
    "NoSamples",
    "WrongSamples",
    "NumberNotes",
    "TextSeed",
    "NoSeconds",
    "Ghosts",
    "FewSlowed",
    "Lists",
    "Complex",
    "Texts",
    "Objects",
    "Nothing",
    "NumberIds",
    "TextKinds",
    "TextActivity",
    "OneActivity",
    "YieldsNumber",
    "YieldsNan",
    "YieldsMuch",
    "YieldsNone",
]


@pytest.fixture
def hostile(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    (tmp_path / "my_hostile_plugin.py").write_text(HOSTILE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield "my_hostile_plugin"
    sys.modules.pop("my_hostile_plugin", None)


def refused_in_a_line(capsys: pytest.CaptureFixture[str], reference: str) -> None:
    """The shell ends with 2, one printable line, and without any file."""
    code = main(["generate", "crosswalk", "--model", reference, "--out", "o"])
    captured = capsys.readouterr()
    assert (code, captured.out) == (2, ""), captured
    assert captured.err.startswith("pd-editor: "), captured.err
    assert captured.err.count("\n") == 1, captured.err
    assert captured.err.rstrip("\n").isprintable(), captured.err
    assert not Path("o").exists()


@pytest.mark.parametrize("name", [*LOADING, *RUNNING])
def test_nothing_escapes_of_foreign_code(hostile: str, capsys, name: str):
    """Some ended the program with 0 and without a word, others with a traceback."""
    refused_in_a_line(capsys, f"{hostile}:{name}")


@pytest.mark.parametrize(
    "code",
    [
        "import sys; sys.exit(0)",
        "import os; os._exit(0)",
        "import os; os.execv('/bin/true', ['true'])",
        "raise SystemExit",
        "raise KeyboardInterrupt",
        "raise BaseException('base')",
        "raise GeneratorExit",
        "class E(Exception):\n  def __str__(self): raise KeyboardInterrupt\nraise E",
        "import sys; sys.modules[__name__] = 5",
    ],
)
def test_nothing_escapes_of_an_import(tmp_path, monkeypatch, capsys, code: str):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    (tmp_path / "my_module_that_ends.py").write_text(code)
    refused_in_a_line(capsys, "my_module_that_ends:G")
    sys.modules.pop("my_module_that_ends", None)


def test_what_foreign_code_does_to_the_process_is_undone(tmp_path, monkeypatch, capsys):
    (tmp_path / "my_noisy_plugin.py").write_text(
        "import os, signal\n"
        "from examples.drift_generator import DriftGenerator\n"
        "class G(DriftGenerator):\n"
        "    def generate(self, request):\n"
        "        print('noise')\n"
        "        os.chdir('/')\n"
        "        signal.signal(signal.SIGINT, signal.SIG_IGN)\n"
        "        signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
        "        child = os.fork()\n"
        "        if not child:\n"
        "            os._exit(0)\n"
        "        os.waitpid(child, 0)\n"
        "        traffic = yield from super().generate(request)\n"
        "        from dataclasses import replace\n"
        "        return replace(traffic, notes=('a' + chr(27) + '[2J' + chr(10) + 'b',))\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    code = main(["generate", "crosswalk", "--model", "my_noisy_plugin:G", "--out", "o"])
    captured = capsys.readouterr()
    assert code == 0
    # Results alone are on stdout, and a relative folder is where the user was.
    assert captured.out.splitlines()[0].startswith("o/")
    assert Path(captured.out.splitlines()[0]).is_dir()
    assert captured.out.replace("\n", "").isprintable()
    assert "noise" in captured.err
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before


def test_a_user_can_still_interrupt(tmp_path: Path):
    (tmp_path / "my_slow_plugin.py").write_text(
        "import sys, time\n"
        "class G:\n"
        "    name = 'slow'\n"
        "    def generate(self, request):\n"
        "        sys.stderr.write('begun\\n'); sys.stderr.flush()\n"
        "        time.sleep(100)\n"
    )
    words = ["generate", "crosswalk", "--model", "my_slow_plugin:G", "--out", "o"]
    running = subprocess.Popen(
        [sys.executable, "-m", "pd_editor", *words],
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert running.stderr is not None
    while "begun" not in running.stderr.readline():
        assert running.poll() is None
    running.send_signal(signal.SIGINT)
    assert "Interrupted" in running.communicate(timeout=60)[1]
    assert running.returncode == 130


def test_evaluation_goes_on_after_code_that_ends_its_process(
    hostile: str, capsys: pytest.CaptureFixture[str]
):
    """The whole evaluation ended with 0 and no results."""
    methods = f"{hostile}:Exits", f"{hostile}:Leaves", "constant-velocity"
    words = ["evaluate", "--data", "crosswalk", "--out", "o", "--methods", *methods]
    code = main([*words, "--workers", "1"])
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err
    assert code in (0, 2), captured
    assert "SystemExit" in captured.out + captured.err + "".join(
        path.read_text() for path in Path("o").rglob("*.md")
    )
