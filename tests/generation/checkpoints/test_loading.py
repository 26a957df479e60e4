"""What is imported when a model is loaded."""

import subprocess
import sys

from pd_editor.base.installed_files import models_folder
from pd_editor.generation.generators import SHIPPED_MODEL


def test_loading_a_model_does_not_import_the_compiler_of_torch():
    """It takes seconds, and nothing is compiled."""
    program = (
        "import sys\n"
        "from pathlib import Path\n"
        "from pd_editor.generation.checkpoints.model_folder import load_model\n"
        "from pd_editor.generation.stages import STAGE_KINDS\n"
        f"load_model(Path({str(models_folder() / SHIPPED_MODEL)!r}), STAGE_KINDS)\n"
        "print('torch._dynamo' in sys.modules)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["False"]
