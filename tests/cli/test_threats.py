"""``pd-editor threats``: lines are texts for ``--guide``."""

from pd_editor.analysis.guidance.report import guidance_problems
from pd_editor.cli.options import guidance_terms_of
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.scene.roles.traffic_choice import drivable_agent_ids
from tests.cli.shell import Shell


def test_each_line_is_a_feasible_term(shell: Shell):
    result = shell.run("threats", "roundabout")
    assert (result.code, result.err) == (0, "")
    assert result.lines
    scenario = open_scenario("roundabout")
    for line in result.lines:
        text, words = line.split("  ", 1)
        (term,) = guidance_terms_of((text,))
        assert "AV" in term.named_ids
        assert not guidance_problems(scenario, (term,), term.guided_ids)
        assert " s" in words


def test_lines_that_hold_beside_who_keeps_its_trajectory_only_say_so(shell: Shell):
    """Of all that are listed, ``generate`` refuses none."""
    for demo in ("downtown", "signalised-junction"):
        scenario = open_scenario(demo)
        everyone, conditions = drivable_agent_ids(scenario), []
        for line in shell.run("threats", demo).lines:
            (term,) = guidance_terms_of((line.split("  ")[0],))
            _, condition, ids = line.partition("; with --agents ")
            assert not guidance_problems(
                scenario, (term,), tuple(ids.split()) or everyone
            )
            conditions.append(bool(condition))
        assert not all(conditions)
        assert any(conditions) == (demo == "downtown")


def test_another_agent_is_named_and_an_unknown_one_refused(shell: Shell):
    result = shell.run("threats", "roundabout", "--to", "car-0012")
    assert result.code == 0
    assert all("car-0012" in line for line in result.lines)
    result = shell.run("threats", "roundabout", "--to", "nobody")
    assert result.code == 2
    assert "nobody" in result.err
