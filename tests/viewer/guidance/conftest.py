"""A tab in which edits do not start the generator."""

import pytest

from tests.viewer.fake_browser import FakeTab


@pytest.fixture
def tab(tab: FakeTab) -> FakeTab:
    """A tab without live regeneration."""
    tab.ui.live = None
    return tab
