"""Guidance terms on recorded scenes: obedience, realism cost, processor time.

For up to three moving vehicles of each scene one request of each kind is made, at default
strength: goals at the ends of trajectories of another seed and along paths that the agent
could take, speeds 4 m/s slower to 4 m/s faster, limits at 70 % of the speed, lines at 45
to 95 % of the way, and paths with a speed, a time or a wait at one way-point. Obedience is that of feasible requests, as ``guidance_problems`` tells
before the run, and of agents that were not slowed afterwards to avoid a collision; the
share of both is told. Realism is that of the whole scene against the unguided sample of the
same seed. Reads the train and val folders under PD_EDITOR_AV2; settings are chosen on
train, headlines are of val.
"""

import argparse
import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from benchmarks.candidates import full_scenarios
from benchmarks.figures import load_in_words
from pd_editor.analysis.guidance.guidance_kind import AgentNow
from pd_editor.analysis.guidance.kinds.course import GoalPoint
from pd_editor.analysis.guidance.kinds.path import FollowPath
from pd_editor.analysis.guidance.kinds.space import StayOnRoad
from pd_editor.analysis.guidance.kinds.speed import (
    ComfortLimits,
    SpeedLimit,
    StopAtLine,
    TargetSpeed,
)
from pd_editor.analysis.guidance.report import SLOWED, guidance_problems
from pd_editor.generation.generators import DEFAULT_GENERATOR, make_generator
from pd_editor.scene.agent_kind import MOTOR_VEHICLE_KINDS
from pd_editor.scene.generation import (
    GeneratedTraffic,
    GenerationRequest,
    TrafficSample,
    guidance_settings,
    run_to_end,
)
from pd_editor.scene.guidance_terms import GuidanceTerm
from pd_editor.scene.roles.traffic_choice import drivable_agent_ids
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.thresholds import STANDING_MPS

AGENTS_PER_SCENE = 3
LEAST_MPS = 2.0


@dataclass
class Tally:
    """What was found of one kind of term."""

    errors: list[float] = field(default_factory=list)
    unguided: list[float] = field(default_factory=list)
    num_infeasible: int = 0
    num_slowed: int = 0
    guided_figures: list[tuple[float, ...]] = field(default_factory=list)
    unguided_figures: list[tuple[float, ...]] = field(default_factory=list)
    num_impossible: int = 0


def generated(
    scenario: Scenario, *terms: GuidanceTerm, seed: int, tries: int | None = None
) -> GeneratedTraffic:
    """Trajectories of all road users, guided by terms."""
    request = GenerationRequest(
        scenario=scenario,
        agent_ids=drivable_agent_ids(scenario, None),
        guidance=(*guidance_settings(None, tries), *terms),
        seed=seed,
    )
    return run_to_end(make_generator(DEFAULT_GENERATOR).generate(request))


def requests(
    scenario: Scenario, other: TrafficSample, random: np.random.Generator
) -> Iterator[GuidanceTerm]:
    """Requests for some moving vehicles and for the whole scene."""
    agents, now = scenario.agents, scenario.current_step
    speed = agents.speed_mps()[:, now]
    moving = [
        name
        for name in other.ids
        if agents.kinds[row := agents.row_of[name]] in MOTOR_VEHICLE_KINDS
        and speed[row] > LEAST_MPS
    ]
    for name in random.permutation(moving)[:AGENTS_PER_SCENE].tolist():
        row = agents.row_of[name]
        agent = AgentNow(scenario=scenario, row=row)
        path = agent.paths_m[random.integers(len(agent.paths_m))]
        least, most = agent.reach_m(agent.duration_s)
        reach = min(least + random.uniform(0.2, 0.7) * (most - least), 150.0)
        node = path[min(round(reach / 2.0), len(path) - 1)]
        end = other.position_m[other.ids.index(name), -1]
        yield GoalPoint(agent_id=name, point_m=(float(end[0]), float(end[1])))
        yield GoalPoint(agent_id=name, point_m=(float(node[0]), float(node[1])))
        yield FollowPath(
            agent_id=name,
            points_m=tuple((float(x), float(y)) for x, y in path[:40:2]),
        )
        target = float(np.clip(speed[row] + random.uniform(-4, 4), 0.0, 25.0))
        yield TargetSpeed(agent_ids=(name,), speed_mps=target)
        yield SpeedLimit(agent_ids=(name,), speed_mps=max(0.7 * speed[row], 1.0))
        away = speed[row] * agent.duration_s * random.uniform(0.45, 0.95)
        at = min(round((away + agents.size_m[row, 0] / 2) / 2.0), len(path) - 2)
        course = path[at + 1] - path[at]
        left = 2.0 * np.array([-course[1], course[0]]) / np.hypot(*course)
        one, two = path[at] - left, path[at] + left
        yield StopAtLine(
            agent_id=name,
            line_m=((float(one[0]), float(one[1])), (float(two[0]), float(two[1]))),
        )
    yield SpeedLimit(speed_mps=8.0)
    yield ComfortLimits()
    yield StayOnRoad()


def way_points(
    scenario: Scenario, random: np.random.Generator
) -> Iterator[tuple[str, GuidanceTerm]]:
    """Paths of some moving vehicles with a speed, a time or a wait half-way."""
    agents, now = scenario.agents, scenario.current_step
    speed = agents.speed_mps()[:, now]
    moving = agents.kind_mask(MOTOR_VEHICLE_KINDS) & (speed > LEAST_MPS)
    rows = random.permutation(np.flatnonzero(moving & agents.is_valid[:, now]))
    for row in rows[:AGENTS_PER_SCENE].tolist():
        agent = AgentNow(scenario=scenario, row=row)
        path = agent.paths_m[random.integers(len(agent.paths_m))][:40:2]
        points = tuple((float(x), float(y)) for x, y in path)
        now_mps = float(speed[row])
        reach = now_mps * random.uniform(2.0, 4.0)
        at = min(max(round(reach / 4.0), 1), len(points) - 2)

        def asked(value: object, at: int = at, count: int = len(points)) -> tuple:
            return tuple(value if one == at else None for one in range(count))

        plain = FollowPath(agent_id=agents.ids[row], points_m=points)
        mps = round(min(max(now_mps + random.uniform(-4, 4), 0.0), 20.0), 1)
        yield "a speed there", replace(plain, speeds_mps=asked(mps))
        at_s = round(reach / now_mps * random.uniform(0.7, 1.4), 1)
        yield "a time there", replace(plain, times_s=asked(at_s))
        for other in random.permutation(rows).tolist():
            if other != row:
                wait = replace(plain, waits_for=asked(agents.ids[other]))
                if not guidance_problems(scenario, (wait,)):
                    yield "a wait there", wait
                    break


def told(split: str, num_scenes: int, seed: int) -> None:
    """Run a split and print its figures."""
    random = np.random.default_rng(seed)
    tallies: dict[str, Tally] = defaultdict(Tally)
    scenarios = full_scenarios(split)[:num_scenes]
    for scenario in scenarios:
        other = generated(scenario, seed=seed + 1).samples[0]
        asked: list[tuple[str, GuidanceTerm]] = [
            (one.kind + ("" if one.guided_ids else " of all"), one)
            for one in requests(scenario, other, random)
        ]
        asked += way_points(scenario, np.random.default_rng(seed))
        for name, term in asked:
            tally = tallies[name]
            if guidance_problems(scenario, (term,)):
                tally.num_infeasible += 1
                continue
            traffic = generated(scenario, term, seed=seed)
            (report,) = traffic.guidance
            for figures, one in (
                (tally.guided_figures, report.cost and report.cost.guided),
                (tally.unguided_figures, report.cost and report.cost.unguided),
            ):
                if one is not None:
                    figures.append(
                        (
                            one.off_road,
                            float(one.num_collisions),
                            one.lateral_deviation_m,
                            one.acceleration_mps2,
                        )
                    )
            if any(one.achieved.endswith(SLOWED) for one in report.outcomes):
                tally.num_slowed += 1
                continue
            tally.num_impossible += bool(report.motion_problems)
            tally.errors += [outcome.error for outcome in report.outcomes]
    print(f"\n{split}: {len(scenarios)} scenes, seed {seed}; {load_in_words()}")
    print(
        f"{'term':20s} {'n':>4s} {'infeas.':>7s} {'slowed':>6s} {'p50':>6s} {'p90':>6s} "
        f"{'max':>6s} | guided / unguided: off-road, collisions, lateral, acceleration"
    )
    for name, tally in tallies.items():
        errors = np.array(tally.errors or [np.nan])
        p50, p90, top = np.percentile(errors, [50, 90, 100])
        pairs = zip(
            np.mean(tally.guided_figures or [(np.nan,) * 4], axis=0),
            np.mean(tally.unguided_figures or [(np.nan,) * 4], axis=0),
            strict=True,
        )
        costs = "  ".join(f"{one:.4f}/{two:.4f}" for one, two in pairs)
        print(
            f"{name:20s} {len(tally.errors):4d} {tally.num_infeasible:7d} "
            f"{tally.num_slowed:6d} {p50:6.2f} {p90:6.2f} {top:6.2f} | {costs} | "
            f"impossible {tally.num_impossible}"
        )


def times(seed: int) -> None:
    """Processor time of 4 steps for 32 agents, with goals of two of them and without."""
    scenario = min(
        full_scenarios("train"),
        key=lambda one: abs(len(drivable_agent_ids(one, None)) - 32),
    )
    ids = drivable_agent_ids(scenario, None)
    speed = scenario.agents.speed_mps()[:, scenario.current_step]
    moving = [one for one in ids if speed[scenario.agents.row_of[one]] > STANDING_MPS]
    found = generated(scenario, seed=seed).samples[0]
    goals = tuple(
        GoalPoint(agent_id=name, point_m=(float(end[0]) + 1.0, float(end[1])))
        for name in moving[:2]
        for end in [found.position_m[found.ids.index(name), -1]]
    )
    model = make_generator(DEFAULT_GENERATOR)
    spent: dict[int, list[float]] = {0: [], 1: [], 2: []}
    for _ in range(20):
        for count, one in spent.items():
            request = GenerationRequest(
                scenario=scenario,
                agent_ids=ids,
                guidance=(*guidance_settings(None, 0), *goals[:count]),
                num_denoising_steps=4,
                reports_cost=False,
                seed=seed,
            )
            before = time.process_time()
            run_to_end(model.generate(request))
            one.append(time.process_time() - before)
    words = ", ".join(
        f"{count} goals {1e3 * float(np.median(one)):.1f} ms"
        for count, one in spent.items()
    )
    print(f"\n{len(ids)} agents, 4 steps, processor time: {words}; {load_in_words()}")


def main() -> None:
    """Print the figures of a split."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--split", default="val", choices=["train", "val"])
    parser.add_argument("--scenes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    told(asked.split, asked.scenes, asked.seed)
    times(asked.seed)


if __name__ == "__main__":
    main()
