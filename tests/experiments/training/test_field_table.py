"""The list of fields tells all that a variant can set, and what can be set is in it."""

import tomllib

import pytest

from pd_editor.experiments.training.run_request import (
    RunRequest,
    StageName,
    new_config,
)
from pd_editor.experiments.training.settings import (
    SECTIONS,
    fields_table,
    settable_fields,
    settings_of,
)

STAGES: tuple[StageName, ...] = ("init", "traj")


@pytest.mark.parametrize("stage", STAGES)
def test_each_field_has_a_sentence_and_its_default_can_be_set(stage: StageName):
    found = settable_fields(stage)
    plain = new_config(RunRequest(stage=stage, data=("/data",)), is_gpu=False)
    for one in found:
        assert one.meaning.endswith("."), f"{one.section}.{one.name} has no docstring"
        text = f"{stage}.{one.section}.{one.name}={one.default}"
        assert tomllib.loads(f"value = {one.default}")
        given = settings_of((), (text,), stage)
        same = new_config(
            RunRequest(stage=stage, data=("/data",), settings=given), is_gpu=False
        )
        if one.section in ("model", "loss", "augmentation"):
            before, after = getattr(plain, one.section), getattr(same, one.section)
            assert before[one.name] == after[one.name]
        elif one.section == "optimisation":
            assert same.optimisation == plain.optimisation
    assert {one.section for one in found} == set(SECTIONS[stage])


def test_the_table_has_a_line_for_each_field():
    lines = fields_table("traj").splitlines()
    assert len(lines) == 2 + len(settable_fields("traj"))
    (blocks,) = [line for line in lines if "`traj.model.num_blocks`" in line]
    assert blocks.startswith(
        "| `traj.model.num_blocks` | 2 | a whole number | Blocks of"
    )
