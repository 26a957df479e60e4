"""``python -m scene_test RECORDED SAMPLED``."""

import argparse
import sys

from scene_test import compare_folders


def main() -> None:
    """Print the AUC, its interval, and the features that tell most."""
    parser = argparse.ArgumentParser(prog="scene_test", description=__doc__)
    parser.add_argument("recorded", help="folder of scenes as tables")
    parser.add_argument("sampled", help="folder of the same scenes, sampled")
    options = parser.parse_args()
    try:
        found = compare_folders(options.recorded, options.sampled)
        print(f"AUC {found} (0.5: they cannot be told apart)")
    except (ValueError, OSError) as error:
        sys.exit(f"scene_test: {error}")


if __name__ == "__main__":
    main()
