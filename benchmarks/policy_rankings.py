"""Whether policies are ranked alike by roll-outs of other seeds, and by log replay.

Policies drive the ego through scenes of a split of PD_EDITOR_AV2, once per seed, and are
ranked by their mean score (nuPlan's names). Kendall's tau is told of each pair of seeds; and
of the first seed against traffic that drives as recorded, both up to the end of the record.
"""

import argparse
import itertools
import os
import tempfile
from pathlib import Path

import numpy as np
from scipy.stats import kendalltau

import pd_editor
from pd_editor.editor.commands import SetLocks
from pd_editor.editor.scenario_store import open_scenario
from pd_editor.experiments.closed_loop.policies import policy_of
from pd_editor.experiments.closed_loop.roll_out import (
    RollOutRequest,
    roll_out,
    route_of,
)
from pd_editor.experiments.closed_loop.scores import Drive, drive_scores, policy_values
from pd_editor.generation.generators import SHIPPED_MODEL, make_generator
from pd_editor.scene.locks import TRAJECTORY_LOCK
from pd_editor.scene.scenario import EGO_ID, Scenario

POLICIES = (
    "idm",
    "constant-velocity",
    "examples.policies.idm_on_route:Idm",
    "examples.policies.torch_policy:TorchPolicy",
    "examples.policies.model_as_planner:ModelPlanner",
)


def as_recorded(scenario: Scenario) -> Scenario:
    """The scenario with all agents but the ego locked."""
    others = tuple(name for name in scenario.agents.ids if name != EGO_ID)
    return SetLocks(agent_ids=others, lock=TRAJECTORY_LOCK).apply(scenario)


def recorded_drives(scenario: Scenario, policies: tuple[str, ...]) -> list[Drive]:
    """Drives among traffic that does not answer."""
    axis, locked, found = scenario.time_axis, as_recorded(scenario), []
    for name in policies:
        policy = policy_of(name)
        request = RollOutRequest(
            scenario=locked,
            duration_s=axis.num_future_steps * axis.step_s,
            policies={EGO_ID: policy},
            keeps_density=False,
        )
        steps = roll_out(request, make_generator(SHIPPED_MODEL))
        while True:
            try:
                next(steps)
            except StopIteration as stop:
                rolled = stop.value
                break
        scores = drive_scores(rolled.scenario, EGO_ID, route_of(scenario, EGO_ID))
        found.append(
            Drive(
                scene=scenario.scenario_id,
                policy=policy.name,
                folder="",
                ended="",
                has_failed=bool(rolled.failed),
                scores=None if rolled.failed else scores,
            )
        )
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--split", default="val")
    parser.add_argument("--scenes", type=int, default=12)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--policies", nargs="+", default=POLICIES)
    options = parser.parse_args()
    root = Path(os.environ["PD_EDITOR_AV2"]) / options.split
    scenes = tuple(sorted(root.glob("*/"))[: options.scenes])
    opened = [open_scenario(one) for one in scenes]
    record_s = min(one.time_axis.num_future_steps * 0.1 for one in opened)
    runs = {
        f"seed {seed}": (seed, options.seconds) for seed in range(options.seeds)
    } | {f"seed 0, {record_s:g} s": (0, record_s)}
    drives: dict[str, list[Drive]] = {}
    for words, (seed, seconds) in runs.items():
        with tempfile.TemporaryDirectory() as out:
            made = pd_editor.drive(
                scenes,
                policies=options.policies,
                seconds=seconds,
                seed=seed,
                out=out,
                workers=os.cpu_count(),
            )
        drives[words] = list(made.records)
    drives["as recorded"] = [
        drive for one in opened for drive in recorded_drives(one, options.policies)
    ]
    means = {}
    for words, found in drives.items():
        names = dict.fromkeys(one.policy for one in found)
        means[words] = np.nanmean(policy_values(found)["score"], axis=1)
        scores = zip(names, means[words], strict=True)
        told = ", ".join(f"{name} {100 * one:.0f}" for name, one in scores)
        print(f"{words}: {told}", flush=True)
    *seeds, short, log = means
    for one, other in (*itertools.combinations(seeds, 2), (short, log)):
        tau, _ = kendalltau(means[one], means[other])
        print(f"Kendall's tau, {one} and {other}: {tau:.2f}")


if __name__ == "__main__":
    main()
