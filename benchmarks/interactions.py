"""Guidance terms on pairs of agents on recorded scenes: obedience and realism.

Collisions avoided (raw samples of the model, the unguided sample of the same seed beside
each), gaps kept, yielding, and threats of each approach and severity, of agents that are
kept and of agents that are sampled. Reads the train or val folder under PD_EDITOR_AV2.
"""

import argparse
import os
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, get_args

import numpy as np

from pd_editor.analysis.guidance.kinds.pairs import Threaten, YieldTo, shared_places
from pd_editor.analysis.guidance.kinds.space import AvoidCollisions, KeepGap
from pd_editor.analysis.guidance.report import guidance_problems
from pd_editor.analysis.threats.encounter import (
    Approach,
    Track,
    encounter,
    exertion,
    limits_of,
)
from pd_editor.analysis.threats.threat_feasibility import meets, recorded_track
from pd_editor.analysis.threats.threat_plans import ThreatAim
from pd_editor.generation.generators import DEFAULT_GENERATOR, make_generator
from pd_editor.scene.agent_kind import MOTOR_VEHICLE_KINDS
from pd_editor.scene.av2_io.read import read_scenario
from pd_editor.scene.generation import (
    AVOIDANCE,
    GeneratedTraffic,
    GenerationRequest,
    GuidanceSetting,
    TrafficSample,
    run_to_end,
)
from pd_editor.scene.guidance_terms import GuidanceTerm, Realism
from pd_editor.scene.roles.traffic_choice import drivable_agent_ids
from pd_editor.scene.scenario import Scenario

RAW: Final = GuidanceSetting(name=AVOIDANCE, weight=0.0)
SEVERITIES: Final = (0.0, 0.25, 0.5, 0.75, 1.0)
NEAR_M: Final = 50.0
MOST_ATTACKERS: Final = 6


def scenes(split: str, most: int) -> Iterator[Scenario]:
    """Recorded scenes of a split."""
    root = Path(os.environ["PD_EDITOR_AV2"])
    for file in sorted((root / split).glob("*/scenario_*.parquet"))[:most]:
        yield read_scenario(file.parent)


def sampled(
    scenario: Scenario,
    ids: tuple[str, ...],
    *terms: GuidanceTerm,
    samples: int,
    seed: int,
    compares: bool = False,
) -> GeneratedTraffic:
    """Raw samples with some terms."""
    request = GenerationRequest(
        scenario=scenario,
        agent_ids=ids,
        num_samples=samples,
        guidance=(RAW, *terms),
        reports_cost=compares,
        seed=seed,
    )
    return run_to_end(make_generator(DEFAULT_GENERATOR).generate(request))


@dataclass(kw_only=True)
class RealismTable:
    """Realism of guided and unguided samples."""

    guided: list[Realism] = field(default_factory=list)
    unguided: list[Realism] = field(default_factory=list)

    def add(self, traffic: GeneratedTraffic) -> None:
        """Add the reports of a run."""
        for report in traffic.guidance:
            assert report.cost is not None
            self.guided.append(report.cost.guided)
            self.unguided.append(report.cost.unguided)

    def told(self, name: str) -> None:
        """Print sums and means."""
        print(f"\n{name}, {len(self.guided)} samples")
        print(f"{'':24}{'unguided':>12}{'guided':>12}{'change':>10}")
        for column, total in (
            ("num_collisions", np.sum),
            ("off_road", np.mean),
            ("lateral_deviation_m", np.mean),
            ("acceleration_mps2", np.mean),
        ):
            before = total([getattr(one, column) for one in self.unguided])
            after = total([getattr(one, column) for one in self.guided])
            change = after / before - 1 if before else np.nan
            print(f"{column:24}{before:12.4f}{after:12.4f}{change:10.1%}")


def avoided(split: str, most: int, samples: int, seed: int) -> None:
    """Collisions with and without the term."""
    table = RealismTable()
    for scenario in scenes(split, most):
        ids = drivable_agent_ids(scenario)
        table.add(
            sampled(
                scenario,
                ids,
                AvoidCollisions(),
                samples=samples,
                seed=seed,
                compares=True,
            )
        )
    table.told(f"avoid collisions, {split}")


def gaps(split: str, most: int, samples: int) -> None:
    """Gaps of all agents to those ahead."""
    for gap in (4.0, 8.0):
        table = RealismTable()
        term, errors = KeepGap(gap_m=gap), []
        for scenario in scenes(split, most):
            ids = drivable_agent_ids(scenario)
            found = sampled(scenario, ids, term, samples=samples, seed=1, compares=True)
            table.add(found)
            errors += [one.outcomes[0].error for one in found.guidance if one.outcomes]
        table.told(f"keep a gap of {gap:g} m, {split}")
        short = np.percentile(errors, [50, 90])
        print(
            f"worst shortfall of a scene: median {short[0]:.2f} m, p90 {short[1]:.2f} m"
        )


def yields(split: str, most: int) -> None:
    """Agents that pass first in the unguided sample are asked to yield."""
    table, met, feasible, count = RealismTable(), 0, 0, 0
    for scenario in scenes(split, most):
        ids = drivable_agent_ids(scenario)
        plain = sampled(scenario, ids, samples=1, seed=1).samples[0]
        for first, second in passing_pairs(plain):
            term = YieldTo(agent_id=plain.ids[first], other_id=plain.ids[second])
            is_feasible = not guidance_problems(scenario, [term], ids)
            found = sampled(scenario, ids, term, samples=1, seed=1, compares=True)
            count, feasible = count + 1, feasible + is_feasible
            met += is_feasible and found.guidance[0].outcomes[0].is_obeyed
            table.add(found)
    if count:
        table.told(f"yield, {split}")
        print(f"{count} pairs, {feasible} feasible, of which {met} obeyed")


def passing_pairs(sample: TrafficSample) -> Iterator[tuple[int, int]]:
    """Pairs of which the first agent passes a place before the second one."""
    moves = np.linalg.norm(sample.position_m[:, -1] - sample.position_m[:, 0], axis=-1)
    drives = np.array([kind in MOTOR_VEHICLE_KINDS for kind in sample.kinds])
    rows = np.flatnonzero((moves > 8) & drives)
    for first in rows.tolist():
        for second in rows.tolist():
            if first == second:
                continue
            shared = shared_places(track(sample, first), track(sample, second))
            if not shared.any() or shared[:10].any() or shared[:, 0].any():
                continue
            place, moment = np.nonzero(shared)
            if (place <= moment).any():
                yield first, second


def track(sample: TrafficSample, row: int) -> Track:
    """Trajectory of an agent of a sample."""
    return Track(
        position_m=sample.position_m[row],
        heading_rad=sample.heading_rad[row],
        velocity_mps=sample.velocity_mps[row],
        size_m=sample.size_m[row],
    )


@dataclass(frozen=True, kw_only=True)
class ThreatRow:
    """One sample of a feasible threat."""

    is_met: bool
    is_within_limits: bool
    is_unchanged: bool
    error_m: float
    largest_mps2: float


def threat_rows(
    scenario: Scenario, *, is_kept: bool, samples: int
) -> Iterator[tuple[Approach, float, list[ThreatRow] | None]]:
    """Threats of agents nearby to the focal one; None of a threat that is infeasible."""
    agents, now = scenario.agents, scenario.current_step
    focal = scenario.focal_id
    ids = drivable_agent_ids(scenario)
    if focal not in ids:
        return
    if is_kept:
        if not agents.is_valid[agents.row_of[focal], now:].all():
            return
        ids = tuple(name for name in ids if name != focal)
    plain = sampled(scenario, ids, samples=samples, seed=1)
    rows = agents.rows(ids)
    gap = agents.position_m[rows, now] - agents.position_m[agents.row_of[focal], now]
    away = np.hypot(gap[:, 0], gap[:, 1])
    near = [
        ids[index]
        for index in np.argsort(away).tolist()
        if ids[index] != focal
        and away[index] < NEAR_M
        and agents.kinds[rows[index]] in MOTOR_VEHICLE_KINDS
    ]
    for name in near[:MOST_ATTACKERS]:
        for approach in get_args(Approach):
            for severity in SEVERITIES:
                term = Threaten(
                    agent_id=name, other_id=focal, approach=approach, severity=severity
                )
                if guidance_problems(scenario, [term], ids):
                    yield approach, severity, None
                    continue
                found = sampled(scenario, ids, term, samples=samples, seed=1)
                pairs = zip(found.samples, plain.samples, strict=True)
                yield (
                    approach,
                    severity,
                    [row_of(scenario, term, one, before) for one, before in pairs],
                )


def row_of(
    scenario: Scenario, term: Threaten, sample: TrafficSample, plain: TrafficSample
) -> ThreatRow:
    """Evaluate one sample."""
    agents, now = scenario.agents, scenario.current_step
    step_s = scenario.time_axis.step_s
    first = track(sample, sample.ids.index(term.agent_id))
    is_unchanged = True
    if term.other_id in sample.ids:
        index = sample.ids.index(term.other_id)
        second = track(sample, index)
        is_unchanged = all(
            np.array_equal(getattr(sample, name)[index], getattr(plain, name)[index])
            for name in ("position_m", "heading_rad", "velocity_mps")
        )
    else:
        second = recorded_track(scenario, agents.row_of[term.other_id])
    aim = ThreatAim.of(term.approach, term.severity)
    found = encounter(first, second, step_s, term.approach)
    until = np.array([round(found.at_s / step_s)]) if found.is_contact else None
    row = agents.row_of[term.agent_id]
    used = exertion(
        first.position_m[None],
        agents.velocity_mps[row, now],
        float(agents.heading_rad[row, now]),
        limits_of(agents.kinds[row]),
        step_s,
        until=until,
    )
    return ThreatRow(
        is_met=meets(aim, found),
        is_within_limits=bool(used.is_possible[0]),
        is_unchanged=is_unchanged,
        error_m=abs(found.counted_gap_m - aim.gap_m),
        largest_mps2=float(used.largest_mps2[0]),
    )


def threats(split: str, most: int, samples: int) -> None:
    """Threats by approach and severity."""
    for is_kept in (True, False):
        began = time.perf_counter()
        table: dict[tuple[Approach, float], list[ThreatRow]] = defaultdict(list)
        asked: dict[tuple[Approach, float], list[bool]] = defaultdict(list)
        for scenario in scenes(split, most):
            for approach, severity, rows in threat_rows(
                scenario, is_kept=is_kept, samples=samples
            ):
                asked[approach, severity].append(rows is not None)
                table[approach, severity] += rows or []
        how = "kept" if is_kept else "sampled"
        print(
            f"\nthreats to the focal agent, {how}, {split} "
            f"({time.perf_counter() - began:.0f} s)"
        )
        print(
            f"{'approach':10}{'severity':>9}{'asked':>7}{'feasible':>9}{'met':>7}"
            f"{'limits':>8}{'both':>7}{'same':>7}{'gap error p90':>15}{'m/s2 p90':>10}"
        )
        for approach in get_args(Approach):
            for severity in SEVERITIES:
                one = (approach, severity)
                line(f"{approach:10}{severity:9.2f}", asked[one], table[one])
        for severity in SEVERITIES:
            some = [(approach, severity) for approach in get_args(Approach)]
            line(
                f"{'all':10}{severity:9.2f}",
                [flag for one in some for flag in asked[one]],
                [row for one in some for row in table[one]],
            )


def line(name: str, asked: list[bool], rows: Iterable[ThreatRow]) -> None:
    """Print one line of the table of threats."""
    found = list(rows)
    begins = f"{name}{len(asked):7d}{sum(asked):9d}"
    if not found:
        print(begins)
        return
    met = np.array([row.is_met for row in found])
    limits = np.array([row.is_within_limits for row in found])
    same = np.array([row.is_unchanged for row in found])
    errors = [row.error_m for row, ok in zip(found, met, strict=True) if ok] or [0.0]
    hardest = np.percentile([row.largest_mps2 for row in found], 90)
    print(
        f"{begins}{met.mean():7.0%}{limits.mean():8.0%}{(met & limits).mean():7.0%}"
        f"{same.mean():7.0%}{np.percentile(errors, 90):13.2f} m{hardest:10.1f}"
    )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--split", default="val")
    parser.add_argument("--scenes", type=int, default=100)
    parser.add_argument("--samples", type=int, default=4)
    parser.add_argument("--seed", type=int, default=1, help="of avoided collisions")
    parser.add_argument(
        "--what",
        nargs="+",
        default=["avoid", "gaps", "yields", "threats"],
        choices=["avoid", "gaps", "yields", "threats"],
    )
    options = parser.parse_args()
    if "avoid" in options.what:
        avoided(options.split, options.scenes, options.samples, options.seed)
    if "gaps" in options.what:
        gaps(options.split, options.scenes, options.samples)
    if "yields" in options.what:
        yields(options.split, options.scenes)
    if "threats" in options.what:
        threats(options.split, options.scenes, options.samples)


if __name__ == "__main__":
    main()
