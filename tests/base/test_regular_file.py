import os
import socket
from pathlib import Path

import pytest

from pd_editor.base.errors import InputError, RecipeError
from pd_editor.base.regular_file import check_path, check_regular, read_regular


def test_a_regular_file_is_read(tmp_path):
    (tmp_path / "a").write_bytes(b"abc")
    assert read_regular(tmp_path / "a", max_bytes=3) == b"abc"
    check_regular(tmp_path / "a", max_bytes=3)


def test_a_larger_file_is_refused_with_the_limit(tmp_path):
    with (tmp_path / "a").open("wb") as file:
        file.truncate(3 * 2**20)
    for read in (read_regular, check_regular):
        with pytest.raises(InputError, match="is larger than 2 MiB"):
            read(tmp_path / "a", max_bytes=2 * 2**20)


def test_devices_pipes_sockets_and_folders_are_refused_at_once(tmp_path):
    """Nothing is read without end, nothing waits for a writer (fault 7)."""
    os.mkfifo(tmp_path / "pipe")
    listening = socket.socket(socket.AF_UNIX)
    listening.bind(str(tmp_path / "socket"))
    for path in ("/dev/zero", tmp_path / "pipe", tmp_path / "socket", tmp_path):
        for read in (read_regular, check_regular):
            with pytest.raises(RecipeError, match=r"not a regular file|cannot be read"):
                read(Path(path), max_bytes=100, error=RecipeError)
    listening.close()


def test_a_size_that_is_untrue_does_not_matter():
    """Files under /proc say that they are empty (fault 7)."""
    with pytest.raises(InputError, match="is larger than"):
        read_regular(Path("/proc/self/maps"), max_bytes=10)


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("a\nb", r"a\\nb: is no usable path"),
        ("a\0b", r"a\\x00b: is no usable path"),
        ("a\udcffb", r"a\\udcffb: is no usable path"),
        ("a" * 256, "at most 255 bytes"),
        ("ä" * 130, "at most 255 bytes"),
        ("a/" * 2100, "4096 bytes in all"),
    ],
)
def test_names_that_no_folder_takes_are_refused_in_one_line(path, words):
    """Line breaks, NUL, lone surrogates, 255 bytes and more (fault 5)."""
    with pytest.raises(InputError, match=words) as told:
        check_path(path)
    assert len(str(told.value)) < 1000
    assert str(told.value).isprintable()
