"""How well labels of manoeuvres agree with those made by eye, and what they cost.

    PD_EDITOR_AV2=/path/to/av2 python -m benchmarks.manoeuvres [--split train]

``tests/analysis/manoeuvres/labels.csv`` names agents and pairs of ``train`` with all that
they do among the kinds that were looked for; rows that were not sure count neither way.
Settings were chosen on these scenes, so the figures are those of a fit.
"""

import argparse
import csv
import os
import time
from collections import defaultdict
from pathlib import Path

from pd_editor.analysis.manoeuvres import SceneEvent, scene_content
from pd_editor.editor.scenario_store import open_scenario

LABELS = Path(__file__).parents[1] / "tests/analysis/manoeuvres/labels.csv"
LANE_CHANGES = ("lane-change-left", "lane-change-right")
ALONE = (*LANE_CHANGES, "left-turn", "right-turn", "u-turn", "straight", "stands")
TOGETHER = ("crossing", "yielding", "merge", "overtaking", "near-miss", "cut-in")
GROUPS = {
    "turns": ("left-turn", "right-turn", "u-turn"),
    "lane changes": LANE_CHANGES,
    "stops": ("stands",),
    "straight": ("straight",),
    **{one: (one,) for one in TOGETHER},
}
SPARE_S = 1.0
"""Times by eye may be wrong by this."""


def main() -> None:
    """Print precision, recall and F1 of each group, then the processor time of a scene."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--split", default="train")
    root = Path(os.environ["PD_EDITOR_AV2"]) / parser.parse_args().split
    asked: dict[tuple[str, frozenset[str]], list[dict[str, str]]] = defaultdict(list)
    with LABELS.open() as file:
        for row in csv.DictReader(file):
            who = frozenset(filter(None, (row["track_id"], row["other_id"])))
            asked[row["scene_id"], who].append(row)
    counts = {name: [0, 0, 0] for name in GROUPS}
    events: dict[str, tuple[SceneEvent, ...]] = {}
    seconds = read = 0.0
    for folder in sorted(root.iterdir()):
        if folder.is_dir():
            began = time.process_time()
            scenario = open_scenario(folder)
            read += time.process_time() - began
            began = time.process_time()
            events[folder.name] = scene_content(scenario).events
            seconds += time.process_time() - began
    for (scene, who), rows in asked.items():
        for name, kinds in GROUPS.items():
            count(counts[name], judged(events[scene], who), rows, kinds)
    for name, (hits, false, missed) in counts.items():
        precision, recall = hits / max(hits + false, 1), hits / max(hits + missed, 1)
        f1 = 2 * hits / max(2 * hits + false + missed, 1)
        print(
            f"{name:<13} right {hits:3}  false {false:3}  missed {missed:3}  "
            f"precision {precision:.2f}  recall {recall:.2f}  F1 {f1:.2f}"
        )
    print(
        f"{len(events)} scenes: {1000 * read / len(events):.0f} ms to read, "
        f"{1000 * seconds / len(events):.0f} ms for events and facts"
    )


def judged(events: tuple[SceneEvent, ...], who: frozenset[str]) -> list[SceneEvent]:
    """Events of a labelled agent alone, or of a labelled pair."""
    kinds = ALONE if len(who) == 1 else TOGETHER
    return [
        one
        for one in events
        if one.kind in kinds
        and ({one.agent_id} if len(who) == 1 else {one.agent_id, one.other_id}) == who
    ]


def count(
    totals: list[int],
    found: list[SceneEvent],
    rows: list[dict[str, str]],
    kinds: tuple[str, ...],
) -> None:
    """Add right, false and missed ones of some kinds of an agent or a pair."""
    if any(row["kind"] == "no lane change" for row in rows) and kinds != LANE_CHANGES:
        return
    only_lanes = all(row["kind"] in LANE_CHANGES for row in rows)
    if only_lanes and len(rows) == 1 and kinds != LANE_CHANGES:
        return
    unsure = {row["kind"] for row in rows if row["is_sure"] == "0"}
    found = [one for one in found if one.kind in kinds and one.kind not in unsure]
    sure = [row for row in rows if row["kind"] in kinds and row["is_sure"] == "1"]
    for row in sure:
        begin, end = float(row["begin_s"]) - SPARE_S, float(row["end_s"]) + SPARE_S
        match = next(
            (
                one
                for one in found
                if one.kind == row["kind"] and one.begin_s < end and one.end_s > begin
            ),
            None,
        )
        totals[0 if match else 2] += 1
        if match:
            found.remove(match)
    totals[1] += len(found)


if __name__ == "__main__":
    main()
