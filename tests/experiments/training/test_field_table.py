"""The list of fields tells all that a variant can set, and what can be set is in it."""

import tomllib

import pytest

from pd_editor.experiments.training.settings import (
    SECTIONS,
    RunRequest,
    StageName,
    fields_table,
    new_config,
    settings_of,
)

STAGES: tuple[StageName, ...] = ("init", "traj")


@pytest.mark.parametrize("stage", STAGES)
def test_each_field_has_a_sentence_and_its_default_can_be_set(stage: StageName):
    plain = new_config(RunRequest(stage=stage, data=("/data",)), is_gpu=False)
    sections = set()
    for line in fields_table(stage).splitlines()[2:]:
        key, default, _, meaning = line.strip("| ").split(" | ")
        _, section, name = key.strip("`").split(".")
        sections.add(section)
        assert meaning.endswith("."), f"{section}.{name} has no docstring"
        text = f"{stage}.{section}.{name}={default}"
        assert tomllib.loads(f"value = {default}")
        given = settings_of((), (text,), stage)
        same = new_config(
            RunRequest(stage=stage, data=("/data",), settings=given), is_gpu=False
        )
        if section in ("model", "loss", "augmentation"):
            before, after = getattr(plain, section), getattr(same, section)
            assert before[name] == after[name]
        elif section == "optimisation":
            assert same.optimisation == plain.optimisation
    assert sections == set(SECTIONS[stage])


def test_a_line_of_the_table():
    lines = fields_table("traj").splitlines()
    (blocks,) = [line for line in lines if "`traj.model.num_blocks`" in line]
    assert blocks.startswith(
        "| `traj.model.num_blocks` | 2 | a whole number | Blocks of"
    )
