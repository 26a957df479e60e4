import pytest

from pd_editor.errors import GenerationError
from pd_editor.generation import ScenarioGenerator
from pd_editor.generators import DEFAULT_GENERATOR, GENERATORS, make_generator


@pytest.mark.parametrize("name", GENERATORS)
def test_each_is_made_by_the_name_it_has(name: str):
    generator = make_generator(name)
    assert isinstance(generator, ScenarioGenerator)
    assert generator.name == name


def test_the_default_is_one_of_them():
    assert DEFAULT_GENERATOR in GENERATORS


def test_a_gpu_is_asked_for_in_vain(monkeypatch: pytest.MonkeyPatch):
    torch = pytest.importorskip("torch")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    for name in GENERATORS:
        if name == "lane-follower":
            assert make_generator(name, device="cuda").name == name
        else:
            with pytest.raises(GenerationError, match="GPU"):
                make_generator(name, device="cuda")


def test_others_are_refused():
    with pytest.raises(GenerationError, match="There is no generator 'crystal-ball'"):
        make_generator("crystal-ball")
