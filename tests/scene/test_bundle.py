import io
import zipfile
from pathlib import Path

import pytest

from pd_editor.base.errors import ExportError
from pd_editor.scene import bundle
from pd_editor.scene.bundle import write_files, zip_folders

FILES = {"a.json": b"{}", "b.parquet": b"\x00\x01" * 500, "recipe.json": b"{}"}
BAD_NAMES = ("", "..", ".hidden", "a/b", "a\\b", "/abs", "a\nb", "a" * 300, "ä")


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_a_zip_holds_the_files_in_one_folder() -> None:
    with zipfile.ZipFile(io.BytesIO(zip_folders({"x": FILES}))) as archive:
        assert archive.testzip() is None
        found = {name: archive.read(name) for name in archive.namelist()}
    assert found == {f"x/{name}": data for name, data in FILES.items()}


def test_equal_files_give_equal_zips() -> None:
    assert zip_folders({"x": FILES}) == zip_folders({"x": dict(FILES)})


@pytest.mark.parametrize("name", BAD_NAMES)
def test_names_that_are_no_file_names_are_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(ExportError, match="cannot be a file's name"):
        zip_folders({"x": {name: b""}})
    with pytest.raises(ExportError, match="cannot be a file's name"):
        zip_folders({name: FILES})
    with pytest.raises(ExportError, match="cannot be a file's name"):
        write_files({name: b""}, tmp_path / "x", forbidden=None)
    assert not list(tmp_path.iterdir())


def test_a_new_folder_is_made_with_its_parents(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "down"
    write_files(FILES, out, forbidden=tmp_path / "input")
    assert content(out) == FILES
    assert list(out.parent.iterdir()) == [out]


def test_an_empty_folder_is_used(tmp_path: Path) -> None:
    write_files(FILES, tmp_path, forbidden=None)
    assert content(tmp_path) == FILES


def test_a_full_folder_is_replaced_only_on_demand(tmp_path: Path) -> None:
    out = tmp_path / "x"
    write_files(FILES, out, forbidden=None)
    newer = {**FILES, "a.json": b"[]", "c.json": b"1"}
    with pytest.raises(ExportError, match="already holds files; choose a new folder"):
        write_files(newer, out, forbidden=None)
    assert content(out) == FILES
    write_files(newer, out, forbidden=None, overwrite=True)
    assert content(out) == newer
    assert list(tmp_path.iterdir()) == [out]


def test_a_folder_with_strange_files_is_never_replaced(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("precious")
    with pytest.raises(ExportError, match="choose a new folder"):
        write_files(FILES, tmp_path, forbidden=None, overwrite=True)
    (tmp_path / "recipe.json").write_text("{}")
    with pytest.raises(ExportError, match=r"'thesis.txt', which is not of this export"):
        write_files(FILES, tmp_path, forbidden=None, overwrite=True)
    assert content(tmp_path) == {"thesis.txt": b"precious", "recipe.json": b"{}"}


def test_a_folder_with_folders_is_never_replaced(tmp_path: Path) -> None:
    (tmp_path / "a.json").mkdir()
    (tmp_path / "recipe.json").write_text("{}")
    with pytest.raises(ExportError, match=r"'a\.json', which is not of this export"):
        write_files(FILES, tmp_path, forbidden=None, overwrite=True)


@pytest.mark.parametrize("inside", [".", "sub", "sub/../."])
def test_the_input_is_never_written_to(tmp_path: Path, inside: str) -> None:
    source = tmp_path / "input"
    write_files(FILES, source, forbidden=None)
    for out in (source / inside, tmp_path / "link" / inside):
        (tmp_path / "link").unlink(missing_ok=True)
        (tmp_path / "link").symlink_to(source, target_is_directory=True)
        with pytest.raises(ExportError, match="is the folder that was opened"):
            write_files({"a.json": b"x"}, out, forbidden=source, overwrite=True)
    assert content(source) == FILES


def test_a_file_in_the_way(tmp_path: Path) -> None:
    (tmp_path / "x").write_text("file")
    with pytest.raises(ExportError, match="is a file; expected a new folder's name"):
        write_files(FILES, tmp_path / "x", forbidden=None)
    with pytest.raises(ExportError, match=r"x/y: cannot be written \("):
        write_files(FILES, tmp_path / "x" / "y", forbidden=None)


def test_odd_paths(tmp_path: Path) -> None:
    (tmp_path / "circle").symlink_to(tmp_path / "circle")
    for out in (tmp_path / "circle", tmp_path / "nul\0"):
        with pytest.raises(ExportError, match=r"no place for a folder|Not a directory"):
            write_files(FILES, out, forbidden=None)


def test_a_failure_midway_leaves_the_old_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "x"
    write_files(FILES, out, forbidden=None)

    def full_disk(path: Path, data: bytes) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(bundle.Path, "write_bytes", full_disk)
    with pytest.raises(ExportError, match="No space left on device"):
        write_files(FILES, tmp_path / "new", forbidden=None)
    with pytest.raises(ExportError, match="No space left on device"):
        write_files({**FILES, "a.json": b"new"}, out, forbidden=None, overwrite=True)
    monkeypatch.undo()
    assert content(out) == FILES
    assert list(tmp_path.iterdir()) == [out]
