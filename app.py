"""Start the scenario editor: ``python app.py`` is ``pd-editor edit``."""

import sys

from pd_editor.cli.main import main

if __name__ == "__main__":
    sys.exit(main(["edit", *sys.argv[1:]]))
