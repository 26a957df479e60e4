import subprocess
import sys

import pytest

_FAULTS = """
import resource, sys
from pd_editor.diffusion.core.memory_reuse import keep_freed_memory
if sys.argv[1] == "kept":
    assert keep_freed_memory(1 << 30)
size = 40_000_000
def faults():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt
b"x" * size
before = faults()
for _ in range(10):
    b"x" * size
print(faults() - before)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="GNU library only")
def test_freed_memory_is_used_again():
    faults = {
        name: int(
            subprocess.run(
                [sys.executable, "-c", _FAULTS, name],
                check=True,
                capture_output=True,
                text=True,
            ).stdout
        )
        for name in ("kept", "returned")
    }
    assert faults["returned"] > 1000
    assert faults["kept"] < faults["returned"] / 10
