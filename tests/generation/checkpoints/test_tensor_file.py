import json
import pickle
from dataclasses import dataclass
from typing import Literal

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from safetensors.torch import save_file
from torch import nn

from pd_editor.base.errors import ModelError
from pd_editor.generation.checkpoints.tensor_file import (
    config_from_json,
    in_half_precision,
    load_into,
    read_tensors,
    write_tensors,
)


class Bomb:
    """Tells on whoever unpickles it."""

    def __reduce__(self):
        return (pytest.fail, ("code of a file was run",))


@dataclass(frozen=True, kw_only=True)
class Config:
    width: int = 4
    rate: float = 0.5
    kind: Literal["a", "b"] = "a"
    is_wide: bool = False


def network():
    model = nn.Sequential(nn.Linear(3, 4), nn.LayerNorm(4))
    model.register_buffer("basis", torch.linspace(0, 1, 7))
    return model


def test_tensors_come_back_with_what_is_to_be_known(tmp_path):
    tensors = {"a": torch.randn(3, 2), "b": torch.arange(4), "c": torch.tensor(2.5)}
    path = tmp_path / "folder" / "x.safetensors"
    sha256 = write_tensors(path, "traj", tensors, {"step": 3})
    found = read_tensors(path, "traj")
    assert (found.about, found.sha256) == ({"step": 3}, sha256)
    assert found.tensors.keys() == tensors.keys()
    for name, one in tensors.items():
        assert torch.equal(found.tensors[name], one)
    assert [one.name for one in path.parent.iterdir()] == ["x.safetensors"]


def test_equal_tensors_make_equal_bytes(tmp_path):
    for name in "ab":
        write_tensors(tmp_path / name, "traj", network().state_dict(), {"z": 1, "y": 2})
    tensors = read_tensors(tmp_path / "a", "traj").tensors
    assert write_tensors(tmp_path / "c", "traj", tensors, {"y": 2, "z": 1}) == (
        read_tensors(tmp_path / "a", "traj").sha256
    )


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(ModelError, match="cannot be read"):
        read_tensors(tmp_path / "none", "traj")
    with pytest.raises(ModelError, match="not a regular file"):
        read_tensors(tmp_path, "traj")


def test_a_place_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(ModelError, match="cannot be written"):
        write_tensors(tmp_path / "file" / "x", "traj", {}, {})


def test_pickles_are_refused_and_never_run(tmp_path):
    for name, write in (
        ("a.safetensors", lambda path: path.write_bytes(pickle.dumps(Bomb()))),
        ("b.safetensors", lambda path: torch.save({"x": Bomb()}, path)),
    ):
        write(tmp_path / name)
        with pytest.raises(ModelError, match="damaged or no safetensors"):
            read_tensors(tmp_path / name, "traj")


def test_files_of_other_programs_are_refused(tmp_path):
    path = tmp_path / "x.safetensors"
    save_file({"a": torch.zeros(2)}, path)
    with pytest.raises(ModelError, match="another program"):
        read_tensors(path, "traj")
    save_file({"a": torch.zeros(2)}, path, {"format": "pt"})
    with pytest.raises(ModelError, match="another program"):
        read_tensors(path, "traj")


def test_files_of_another_kind_are_refused(tmp_path):
    write_tensors(tmp_path / "x", "init", {"a": torch.zeros(1)}, {})
    with pytest.raises(ModelError, match="'init'; expected 'traj'"):
        read_tensors(tmp_path / "x", "traj")


@given(cut=st.integers(0, 400), at=st.integers(0, 100))
def test_damaged_files_never_do_worse_than_be_refused(tmp_path_factory, cut, at):
    path = tmp_path_factory.mktemp("cut") / "x"
    write_tensors(path, "traj", {"a": torch.ones(20)}, {"step": 1})
    data = bytearray(path.read_bytes())
    data[at] ^= 0x15
    path.write_bytes(bytes(data[:cut]))
    if cut >= len(data):
        return
    with pytest.raises(ModelError):
        read_tensors(path, "traj")


def test_weights_must_fit_exactly():
    model = network()
    before = {name: one.clone() for name, one in model.state_dict().items()}
    good = network().state_dict()
    for change, words in (
        (lambda t: t.pop("0.bias"), "1 tensors missing"),
        (lambda t: t.update(more=torch.zeros(1)), "1 unknown, such as 'more'"),
        (lambda t: t.update({"0.weight": torch.zeros(4, 2)}), "shape"),
        (lambda t: t.update({"0.bias": torch.zeros(4, dtype=torch.int64)}), "holds"),
        (lambda t: t["1.bias"].fill_(torch.nan), "NaN"),
    ):
        tensors = {name: one.clone() for name, one in good.items()}
        change(tensors)
        with pytest.raises(ModelError, match=words):
            load_into(model, tensors, "here")
    for name, one in model.state_dict().items():
        assert torch.equal(one, before[name])
    load_into(model, good, "here")
    assert torch.equal(model.state_dict()["0.weight"], good["0.weight"])


def test_half_precision_spares_what_is_no_weight():
    model = network()
    half = in_half_precision(model)
    assert half["0.weight"].dtype == torch.float16
    assert half["basis"].dtype == torch.float32
    fresh = network()
    load_into(fresh, half, "here")
    assert fresh.state_dict()["0.weight"].dtype == torch.float32
    assert torch.allclose(
        fresh.state_dict()["0.weight"], model.state_dict()["0.weight"], atol=1e-3
    )


def test_configurations_come_back():
    values = json.loads('{"width": 8, "rate": 1, "kind": "b", "is_wide": true}')
    found = config_from_json(Config, values, "here")
    assert found == Config(width=8, rate=1, kind="b", is_wide=True)


@pytest.mark.parametrize(
    "change",
    [
        {"width": "8"},
        {"width": True},
        {"width": 1.5},
        {"kind": "c"},
        {"kind": []},
        {"rate": None},
        {"more": 1},
    ],
)
def test_other_configurations_are_refused(change):
    values = {"width": 8, "rate": 0.1, "kind": "a", "is_wide": False, **change}
    with pytest.raises(ModelError, match="here"):
        config_from_json(Config, values, "here")
    del values["rate"]
    with pytest.raises(ModelError, match="field"):
        config_from_json(Config, values, "here")
