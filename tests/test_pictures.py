"""The pictures of documents show the editor of today."""

import re
from pathlib import Path

from PIL import Image

from assets.make_pictures import MAKERS, PICTURES, SOFTWARE, stamp

ROOT = Path(__file__).parents[1]
MOST_BYTES = 400_000


def test_pictures_of_the_editor_are_of_its_version():
    """README showed an editor of two versions ago; ``make_pictures`` makes them anew."""
    for name in MAKERS:
        path = PICTURES / f"{name}.webp"
        with Image.open(path) as picture:
            assert picture.getexif().get(SOFTWARE) == stamp(), name
        assert path.stat().st_size < MOST_BYTES


def test_documents_show_every_picture_and_no_other():
    documents = [
        *(ROOT / folder / "README.md" for folder in ("", "reproduction")),
        *(ROOT / "docs").glob("*.md"),
    ]
    shown = {
        (page.parent / name).resolve()
        for page in documents
        for name in re.findall(r"!\[[^]]*\]\(([^)]+)\)", page.read_text())
    }
    made = {path.resolve() for path in PICTURES.iterdir()}
    assert made <= shown
    assert all(path.exists() for path in shown)
