import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.shell import ROOT

SCRIPT = """
import sys, time
from pathlib import Path
from pd_editor.viewer import viewer_app

viewer_app.WARM_UP_AFTER_S = 0.0
app = viewer_app.ViewerApp(reference="crosswalk", port=0, library=Path(sys.argv[1]))
app._warm_up.start()
time.sleep(float(sys.argv[2]))
app.stop()
"""


@pytest.mark.parametrize("seconds", [0.5, 1.5, 2.5])
def test_ending_while_a_model_is_loaded_is_a_clean_end(tmp_path: Path, seconds: float):
    """A thread that ended inside torch aborted the process at its exit."""
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(tmp_path), str(seconds)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
