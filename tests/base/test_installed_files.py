from pathlib import Path

import pytest

from pd_editor.base import installed_files
from pd_editor.base.errors import InputError
from pd_editor.base.installed_files import (
    demo_folder,
    demo_names,
    demo_sentence,
    models_folder,
)


def test_demos_are_found_in_a_checkout():
    assert {"signalised-junction", "winding-street"} <= set(demo_names())
    for name in demo_names():
        assert (demo_folder(name) / f"scenario_{name}.parquet").is_file()
        assert (demo_folder(name) / f"log_map_archive_{name}.json").is_file()
    assert models_folder().is_dir()


def test_a_wheel_keeps_them_inside_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    demo = tmp_path / "assets" / "demos" / "inside"
    demo.mkdir(parents=True)
    (demo / "scenario_inside.parquet").write_bytes(b"")
    monkeypatch.setattr(installed_files, "_PACKAGE", tmp_path)
    assert demo_names() == ("inside",)
    assert demo_folder("inside") == demo
    assert demo_sentence("inside") == ""


@pytest.mark.parametrize("name", ["", "..", "nowhere", "../demos/winding-street"])
def test_only_names_of_demos_are_taken(name: str):
    with pytest.raises(InputError, match="choose one of bus-stop, crosswalk"):
        demo_folder(name)
