import sys
from collections.abc import Iterator
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

from pd_editor.errors import GenerationError
from pd_editor.generation import GenerationRequest, run_to_end
from pd_editor.generators import catalogue_with, make_generator
from pd_editor.generators import plugins as plugins_module
from pd_editor.scene.agent_kind import AgentKind
from pd_editor.scene.guidance_terms import GoalPoint
from tests.builders import scenario_with, straight_drivers

DRIFT = "examples.drift_generator:DriftGenerator"

DRIVERS = [(0, 0, 0, 10), (30, 0, 0, 5), (0, 3.5, 0, 0.5)]

FAULTY = """
import numpy as np
from dataclasses import replace
from examples.drift_generator import DriftGenerator
from pd_editor.prediction import Prediction

NUMBER = 3

class Raises:
    name = "raises"
    def generate(self, request):
        raise KeyError("no such lane")

class Nothing:
    name = "nothing"
    def generate(self, request):
        yield from ()

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
        from pd_editor.generation import GuidanceReport
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
        from pd_editor.generation import run_to_end
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
