"""What is known of the warped roads that weights have seen."""

import pytest

from pd_editor.generation.generators import saw_warps, warp_share

NEVER = {"augmentation": {"warp_share": 0.0}, "start": ""}


@pytest.mark.parametrize(
    ("record", "expected"),
    [
        ({}, True),
        (NEVER, False),
        ({**NEVER, "augmentation": {"warp_share": 0.3}}, True),
        # Earlier versions did not record what the model of the start had seen.
        ({**NEVER, "start": "earlier"}, True),
        ({**NEVER, "start": "earlier", "saw_warps": False}, False),
        ({**NEVER, "start": "earlier", "saw_warps": True}, True),
        ({**NEVER, "averaged_with": [NEVER]}, False),
        ({**NEVER, "averaged_with": [NEVER, {**NEVER, "saw_warps": True}]}, True),
    ],
)
def test_weights_remember_warped_roads(record: dict, expected: bool):
    assert saw_warps(record) is expected


def test_the_share_before_it_was_recorded():
    assert warp_share({}) == 0.3
    assert warp_share(NEVER) == 0.0
