from pathlib import Path
from unittest import mock

from pd_editor.base.errors import EditError
from tests.viewer.fake_browser import connected_tab, running_app


def test_what_is_refused_again_and_again_is_told_once(tmp_path: Path):
    """A key that was held covered the picture with equal notices."""
    with running_app(tmp_path, "crosswalk") as app, connected_tab(app) as tab:
        told = [mock.Mock() for _ in range(3)]
        with mock.patch.dict(vars(tab.ui), notify=mock.Mock(side_effect=told)):
            for words in ("No lane.", "No lane.", "No agent."):
                tab.run(lambda words=words: tab.ui.report(EditError(words)))
        assert [one.remove.called for one in told] == [True, False, False]
