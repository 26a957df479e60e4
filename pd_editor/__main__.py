"""``python -m pd_editor`` is ``pd-editor``."""

import sys

from pd_editor.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
