"""Queries against the definition: a scene at a time, an event at a time."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from pd_editor.analysis.manoeuvres.events import EVENT_KINDS
from pd_editor.analysis.manoeuvres.scene_facts import FACTS
from pd_editor.base.errors import InputError
from pd_editor.experiments.scene_index.index_file import SCHEMA, SceneIndex
from pd_editor.experiments.scene_index.query import find_scenes

KINDS = ("vehicle", "bus", "pedestrian")


def made_rows(count: int) -> list[dict[str, Any]]:
    random = np.random.default_rng(3)
    rows = []
    for number in range(count):
        facts = {
            name: float(random.integers(0, 40)) if kind is float else "no"
            for name, kind in FACTS.items()
        }
        events = [
            {
                "kind": str(random.choice(list(EVENT_KINDS))),
                "agent_id": str(one),
                "agent_kind": str(random.choice(KINDS)),
                "other_id": "AV",
                "other_kind": str(random.choice(KINDS)),
                "begin_s": 0.0,
                "end_s": 1.0,
                "value": float(random.random() * 4) if random.random() < 0.8 else None,
            }
            for one in range(random.integers(0, 6))
        ]
        city = str(random.choice(["Miami", "palo alto"]))
        rows.append(
            {
                **facts,
                "path": str(number),
                "stamp": "read",
                "scenario_id": str(number),
                "city": city,
                "events": events,
            }
        )
    return rows


ROWS = made_rows(300)
INDEX = SceneIndex(folder=Path("/"), table=pa.Table.from_pylist(ROWS, schema=SCHEMA))


def happens(row: dict[str, Any], holds: Callable[[dict[str, Any]], bool]) -> bool:
    return any(map(holds, row["events"]))


@pytest.mark.parametrize(
    ("query", "holds"),
    [
        ("cut-in", lambda r: happens(r, lambda e: e["kind"] == "cut-in")),
        (
            "density > 20 and city = miami",
            lambda r: r["density"] > 20 and r["city"] == "Miami",
        ),
        ('city != "palo alto"', lambda r: r["city"] == "Miami"),
        (
            "left-turn by bus",
            lambda r: happens(
                r, lambda e: (e["kind"], e["agent_kind"]) == ("left-turn", "bus")
            ),
        ),
        (
            "pet < 1.5",
            lambda r: happens(
                r,
                lambda e: (
                    EVENT_KINDS[e["kind"]] == "pet"
                    and e["value"] is not None
                    and e["value"] < 1.5
                ),
            ),
        ),
        (
            "crossing by vehicle with pedestrian pet >= 2 or not (agents <= 30)",
            lambda r: (
                r["agents"] > 30
                or happens(
                    r,
                    lambda e: (
                        e["kind"] == "crossing"
                        and (e["agent_kind"], e["other_kind"])
                        == ("vehicle", "pedestrian")
                        and e["value"] is not None
                        and e["value"] >= 2
                    ),
                )
            ),
        ),
        (
            "turn AND NOT lane-change",
            lambda r: (
                happens(r, lambda e: e["kind"].endswith("-turn"))
                and not happens(r, lambda e: e["kind"].startswith("lane-change"))
            ),
        ),
    ],
)
def test_a_query_finds_what_its_words_say(query: str, holds: Callable[[Any], bool]):
    found = [one.scenario_id for one in find_scenes(INDEX, query)]
    assert found == [row["scenario_id"] for row in ROWS if holds(row)]
    assert 0 < len(found) < len(ROWS)


def test_the_events_that_were_asked_for_are_told_and_no_others():
    for one in find_scenes(INDEX, "(cut-in or merge) and not u-turn"):
        (row,) = (row for row in ROWS if row["scenario_id"] == one.scenario_id)
        expected = [
            e["agent_id"] for e in row["events"] if e["kind"] in ("cut-in", "merge")
        ]
        assert [event.agent_id for event in one.events] == expected


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("cutin", ("'cutin'", "character 1", "cut-in")),
        ("cut-in and densty > 2", ("'densty'", "character 12", "density")),
        ("left-turn by truck", ("'truck'", "bus")),
        ("density > many", ("'many'", "number")),
        ("density cut-in", ("'cut-in'", "<=")),
        ("city > miami", ("'>'", "!=")),
        ("cut-in pet < 2", ("'pet'", "it has headway")),
        ("(cut-in", ("bracket", "after 'cut-in'")),
        ("name = x", ("'name'", "character 1", "cut-in", "density > 20")),
        ("junction = yes", ("'yes'", "junction =", "roundabout")),
        ('edited != "true"', ("'\"true\"'", "edited !=", "yes")),
        ("cut-in) or merge", ("')'",)),
        ("cut-in and", ("ends after 'and'", "cut-in", "density > 20")),
        ("density >", ("ends after '>'", "a number")),
        ("", ("is empty", "cut-in")),
        ("cut-in \x00;drop", ("\\x00",)),
        ("(" * 400 + "cut-in" + ")" * 400, ("nested",)),
        ("not " * 400 + "merge", ("nested",)),
        ('city = "', ('"',)),
        ("density > nan", ("'nan'",)),
        ("merge " * 2000, ("longer",)),
    ],
)
def test_a_wrong_word_is_named_with_its_place_and_the_nearest(
    query: str, words: tuple[str, ...]
):
    with pytest.raises(InputError) as error:
        find_scenes(INDEX, query)
    told = str(error.value)
    for word in words:
        assert word in told
    assert len(told) < 170, "one sentence, which a line of the browser can show"
    assert told.endswith(".")
    assert ": is" not in told


def test_facts_told_beside_an_index_are_asked_with_it():
    """Scenes that were not read yet are found by these alone."""
    told = {str(n): {"power": n / 10, "parent": "Bend"} for n in range(290, 310)}
    index = INDEX.beside({**told, "0": {"parent": "other"}})

    def found(query: str) -> list[str]:
        return [one.scenario_id or one.path for one in find_scenes(index, query)]

    assert found("power > 29.95") == [f"/{n}" for n in range(300, 310)]
    assert found("parent = bend and power <= 29.1") == ["290", "291"]
    assert found("parent = other or power = 29") == ["0", "290"]
    read = [str(n) for n in range(290, 300)]
    assert found("parent = bend and (agents >= 0 or not agents >= 0)") == read
    # Of what has no such value, nothing holds.
    assert len(found("power != 29")) == 19
    with pytest.raises(InputError, match="the nearest is power"):
        find_scenes(index, "powr > 2")
    with pytest.raises(InputError, match="parent is a text"):
        find_scenes(index, "parent > 2")
    assert find_scenes(INDEX.beside({}), "agents >= 0") == find_scenes(
        INDEX, "agents >= 0"
    )
