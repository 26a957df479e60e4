"""Queries of one line, such as ``cut-in by bus and density > 20 and city = miami``, and what they find."""

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
from jaxtyping import Bool

from pd_editor.analysis.findings.scorecard import ROWS
from pd_editor.analysis.manoeuvres.events import EVENT_KINDS, SceneEvent
from pd_editor.analysis.manoeuvres.scene_facts import FACT_VALUES, FACTS
from pd_editor.base.errors import InputError
from pd_editor.base.plain_text import (
    MAX_TEXT_CHARACTERS,
    nearest_or_all,
    one_line,
)
from pd_editor.experiments.scene_index.index_file import (
    COMPARISONS,
    EventTable,
    SceneIndex,
)
from pd_editor.scene.agent_kind import ROAD_USER_KINDS

EVENT_WORDS: Final = {
    **{one: (one,) for one in EVENT_KINDS},
    "lane-change": ("lane-change-left", "lane-change-right"),
    "turn": ("left-turn", "right-turn", "u-turn"),
}
"""Kinds of events that a word stands for."""
_CONDITION: Final = "an event such as cut-in, a quantity such as pet < 2, or a fact such as density > 20"
_QUANTITIES: Final = frozenset(filter(None, EVENT_KINDS.values()))
_WORD: Final = re.compile(r'\s*(<=|>=|!=|[=<>()]|"[^"]*"|[^\s=<>()!"]+|\S)')


@dataclass(frozen=True, kw_only=True)
class Answer:
    """Scenes for which a condition holds, and events that it asks for."""

    scenes: Bool[np.ndarray, "S"]
    events: Bool[np.ndarray, "E"]
    missed: tuple[str, ...] = ()
    """Texts that no scene has, each with those that there are."""


def answer(text: str, table: EventTable) -> Answer:
    """Parse a query and answer it.

    Raises:
        InputError: it is none; the message names the word, its place, and the nearest
            word that is known.
    """
    if len(text) > MAX_TEXT_CHARACTERS:
        raise InputError(f"The query is longer than {MAX_TEXT_CHARACTERS} characters.")
    words = [(one[1], one.start(1) + 1) for one in _WORD.finditer(text.rstrip())]
    parser = _Parser(words, table)
    found = parser.any_of()
    if parser.peek():
        raise parser.wrong("and, or, by, with, or the end")
    if parser.asks_content:
        # Of what was not read yet, nothing holds, its opposite included.
        found = replace(found, scenes=found.scenes & table.is_read)
    return replace(found, missed=tuple(dict.fromkeys(parser.missed)))


class _Parser:
    """Reads words from left to right."""

    def __init__(self, words: list[tuple[str, int]], table: EventTable) -> None:
        self._words, self._table = words, table
        self._next = self._depth = 0
        self.asks_content = False
        """Whether a condition is about what happens in scenes."""
        self.missed: list[str] = []
        """Texts that were asked for, and that no scene has."""

    def peek(self) -> str:
        """The next word in small letters; empty at the end."""
        left = self._words[self._next : self._next + 1]
        return left[0][0].lower() if left else ""

    def wrong(self, expected: str, fault: str = "") -> InputError:
        """The error of the next word, which is not as expected or has a fault."""
        if not self.peek():
            last = self._words[-1][0] if self._words else ""
            where = f"ends after {one_line(last, 60)!r}" if last else "is empty"
            return InputError(f"The query {where}: expected {expected}.")
        text, place = self._words[self._next]
        word = repr(one_line(text, 60))
        told = f"{word} {fault}" if fault else f"expected {expected}, not {word}"
        return InputError(f"Query, character {place}: {told}.")

    def _unknown(
        self, known: Iterable[str], expected: str, after: str = ""
    ) -> InputError:
        """The error of the next word, which is none of those known."""
        where = f" after {after}" if after else ""
        told = nearest_or_all(self.peek(), known, expected)
        return self.wrong(expected, f"is not known{where}; {told}")

    def any_of(self) -> Answer:
        """Conditions between or."""
        found = self._all_of()
        while self._takes("or"):
            more = self._all_of()
            found = Answer(
                scenes=found.scenes | more.scenes, events=found.events | more.events
            )
        return found

    def _all_of(self) -> Answer:
        found = self._one()
        while self._takes("and"):
            more = self._one()
            found = Answer(
                scenes=found.scenes & more.scenes, events=found.events | more.events
            )
        return found

    def _one(self) -> Answer:
        self._depth += 1
        if self._depth > 50:
            raise self.wrong(_CONDITION, "is nested too deeply")
        if self._takes("not"):
            found = self._one()
            found = Answer(scenes=~found.scenes, events=np.zeros_like(found.events))
        elif self._takes("("):
            found = self.any_of()
            if not self._takes(")"):
                raise self.wrong("and, or, or the closing bracket")
        else:
            found = self._condition()
        self._depth -= 1
        return found

    def _condition(self) -> Answer:
        name, facts = self.peek(), self._table.facts
        self.asks_content |= name in FACTS or name not in facts
        if name in facts:
            self._next += 1
            sign = self._word(name, COMPARISONS)
            if facts[name] is str and sign not in ("=", "!="):
                self._next -= 1
                raise self.wrong(f"= or != ({name} is a text)")
            value = self._number() if facts[name] is float else self._text(name, sign)
            scenes = self._table.having(name, sign, value)
            if sign == "=" and isinstance(value, str) and not scenes.any():
                self.missed.append(self._table.told_missing(name, value))
            none = self._table.events((), "", "")
            return Answer(scenes=scenes, events=none)
        compares = self._words[self._next + 1 : self._next + 2]
        is_quantity = bool(compares) and compares[0][0] in COMPARISONS
        kinds = tuple(EVENT_KINDS)
        if not (name in _QUANTITIES and (is_quantity or name not in EVENT_WORDS)):
            if name in ROWS:
                fault = "is a metric, which none of these scenes has in a card;"
                run = "'pd-editor library metrics' computes it for those of a library"
                raise self.wrong("", f"{fault} {run}")
            known = {
                **EVENT_WORDS,
                **facts,
                **dict.fromkeys((*sorted(_QUANTITIES), *ROWS)),
            }
            kinds = EVENT_WORDS.get(name, ())
            if not kinds:
                raise self._unknown(known, _CONDITION)
            self._next += 1
        return self._event(kinds)

    def _event(self, kinds: tuple[str, ...]) -> Answer:
        """What is told of one event."""
        by = towards = ""
        valued = []
        while True:
            if self._takes("by"):
                by = self._word("by", sorted(map(str, ROAD_USER_KINDS)))
            elif self._takes("with"):
                towards = self._word("with", sorted(map(str, ROAD_USER_KINDS)))
            elif (name := self.peek()) in _QUANTITIES:
                own = {EVENT_KINDS[one] for one in kinds}
                if name not in own:
                    has = ", ".join(filter(None, own)) or "none"
                    raise self.wrong(
                        "and", f"is no quantity of this event; it has {has}"
                    )
                kinds = tuple(one for one in kinds if EVENT_KINDS[one] == name)
                self._next += 1
                sign = self._word(name, COMPARISONS)
                valued.append(self._table.valued(sign, self._number()))
            else:
                break
        events = np.logical_and.reduce(
            [self._table.events(kinds, by, towards), *valued]
        )
        return Answer(scenes=self._table.with_any(events), events=events)

    def _takes(self, word: str) -> bool:
        takes = self.peek() == word
        self._next += takes
        return takes

    def _word(self, after: str, known: Any) -> str:
        word = self.peek().strip('"')
        if word not in known:
            raise self._unknown(known, f"one of {', '.join(known)}", after)
        self._next += 1
        return word

    def _text(self, name: str, sign: str) -> str:
        word = self.peek().strip('"')
        if not word or word in (*COMPARISONS, "(", ")"):
            raise self.wrong("a text")
        if name in FACT_VALUES:
            return self._word(f"{name} {sign}", FACT_VALUES[name])
        self._next += 1
        return word

    def _number(self) -> float:
        try:
            number = float(self.peek())
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            raise self.wrong("a number")
        self._next += 1
        return number


_SHOWN = ("kind", "agent_id", "other_id", "begin_s", "end_s", "value")


@dataclass(frozen=True, kw_only=True)
class FoundScene:
    """A scene that a query describes."""

    path: str
    scenario_id: str
    facts: dict[str, float | str]
    events: tuple[SceneEvent, ...]
    """Events that the query asked for, in the order in which they begin."""


def find_places(index: SceneIndex, query: str) -> set[str]:
    """Places of the scenes of an index that a query describes; raises as ``find_scenes``."""
    rows = np.flatnonzero(answer(query, EventTable.of(index.table)).scenes)
    paths = index.table.column("path").take(pa.array(rows)).to_pylist()
    return set(map(index.place_of, paths))


def texts_missed(index: SceneIndex, query: str) -> tuple[str, ...]:
    """Texts that a query asks for and no scene has, with those that there are, as sentences."""
    return answer(query, EventTable.of(index.table)).missed


def find_scenes(index: str | Path | SceneIndex, query: str) -> tuple[FoundScene, ...]:
    """Scenes of an index that a query describes, in its order.

    Raises:
        InputError: the index cannot be read, or the query not understood.
    """
    if not isinstance(index, SceneIndex):
        index = SceneIndex.read(index)
    columns = EventTable.of(index.table)
    found = answer(query, columns)
    rows = np.flatnonzero(found.scenes)
    shown = np.flatnonzero(found.events & found.scenes[columns.scene])
    events: dict[int, list[SceneEvent]] = {row: [] for row in rows.tolist()}
    values = [columns.event[name].take(pa.array(shown)).to_pylist() for name in _SHOWN]
    for row, *told in zip(columns.scene[shown].tolist(), *values, strict=True):
        events[row].append(SceneEvent(**dict(zip(_SHOWN, told, strict=True))))
    head = index.table.select(["path", "scenario_id", *columns.facts]).take(
        pa.array(rows)
    )
    return tuple(
        FoundScene(
            path=index.place_of(one.pop("path")),
            scenario_id=one.pop("scenario_id"),
            facts={name: fact for name, fact in one.items() if fact is not None},
            events=tuple(sorted(events[row], key=lambda event: event.begin_s)),
        )
        for row, one in zip(rows.tolist(), head.to_pylist(), strict=True)
    )
