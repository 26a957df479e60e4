"""The strip of samples over the picture: compare the samples of a run and choose one."""

import base64
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from pd_editor.analysis.findings.check import scene_findings
from pd_editor.analysis.findings.finding import Finding
from pd_editor.analysis.findings.sample_ranking import (
    RANKING_WORDS,
    RANKINGS,
    Ranking,
    SampleNumbers,
    numbers_of,
    ranked,
    spread_pick,
    with_fullness,
)
from pd_editor.base.plain_text import number_of
from pd_editor.editor.background_job import BackgroundJob
from pd_editor.editor.commands import Command, ReplaceTraffic
from pd_editor.editor.commands.locks import apply_within_locks
from pd_editor.editor.commands.roll_out import begun_like
from pd_editor.editor.edit_findings import edit_findings
from pd_editor.editor.library.thumbnail import PictureFrame, thumbnail
from pd_editor.scene.generation import TrafficSample
from pd_editor.scene.scenario import Scenario
from pd_editor.viewer.overlay.messages import (
    CardLine,
    Choice,
    SamplePicturesState,
    SamplesState,
    StripCard,
    StripEvent,
)
from pd_editor.viewer.scene.scene_pair import ScenePair
from pd_editor.viewer.scene.viewpoint import Viewpoint
from pd_editor.viewer.state.events import Signal
from pd_editor.viewer.tab.ui_context import UiContext

PICKS: Final = (2, 3, 4, 6)
"""Sizes of a diverse choice that are offered, as far as there are more samples."""
SECONDS_DIGITS: Final = 1
_KINDS: Final[Mapping[str, str]] = {
    "collision": "collision",
    "later-collision": "collision",
    "off-road": "off-road",
    "later-off-road": "off-road",
    "friction": "too fast",
    "impossible-motion": "impossible",
    "against-traffic": "against traffic",
    "sharp-road": "sharp bend",
    "folded-road": "sharp bend",
    "guidance-not-run": "unguided",
    "guidance-not-met": "unmet guidance",
}
"""Kinds of problems, in few words, in the order in which a card tells them."""
COVERED_PX: Final = 344
"""Height of the picture's lower part that the strip and what is under it cover."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SampleSet:
    """The samples of a run, each of which replaces traffic of the same scenario."""

    before: Scenario
    """The scenario to which one of the samples is applied."""
    base: Scenario
    done: tuple[Command, ...]
    """The edits that made it from ``base``."""
    samples: tuple[TrafficSample, ...]
    commands: tuple[ReplaceTraffic, ...]
    """The edit that applies each sample."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SampleCards:
    """What the strip shows of each sample."""

    scenarios: tuple[Scenario, ...]
    findings: tuple[tuple[Finding, ...], ...]
    """What edits and the sample cause, as the list tells once it is adopted."""
    numbers: tuple[SampleNumbers, ...]
    frame: PictureFrame
    """Of all pictures."""
    pictures: tuple[str, ...]
    """Top views, as SVG."""
    spread: tuple[int, ...]
    """All samples, the most diverse ones first."""

    @classmethod
    def of(cls, samples: SampleSet) -> "SampleCards":
        """Compute numbers and pictures of all samples.

        Raises:
            PdEditorError: a sample cannot be applied.
        """
        scenarios = tuple(
            apply_within_locks(command, samples.before) for command in samples.commands
        )
        recorded = scene_findings(begun_like(samples.base, samples.done))
        checks = [
            edit_findings(one, samples.base, (*samples.done, command), recorded)
            for one, command in zip(scenarios, samples.commands, strict=True)
        ]
        numbers = with_fullness(
            numbers_of(scenario, command.sample.ids, check)
            for scenario, command, check in zip(
                scenarios, samples.commands, checks, strict=True
            )
        )
        frame = PictureFrame.around_agents(
            [
                (one, [name for name in sample.ids if name in one.agents.row_of])
                for one, sample in zip(scenarios, samples.samples, strict=True)
            ]
        )
        count = len(samples.samples)
        return cls(
            scenarios=scenarios,
            findings=tuple(check.new for check in checks),
            numbers=numbers,
            frame=frame,
            pictures=tuple(thumbnail(one, frame) for one in scenarios),
            spread=spread_pick(samples.samples, count, first=ranked(numbers)[0]),
        )


class SampleStrip:
    """The element ``samples``: cards of a run's samples, above the timeline.

    Pointing at a card shows its sample in the scene, without an edit; a click adopts it.
    """

    def __init__(self, ui: UiContext, viewpoint: Viewpoint) -> None:
        """Show nothing yet; new cards uncover what the viewpoint shows under them."""
        self._ui = ui
        self._model = ui.model
        self._overlay = ui.overlay
        self._viewpoint = viewpoint
        self.adopted = Signal[int]()
        """A sample is to be applied in the place of the one that is applied."""
        self.opened = Signal[()]()
        self._samples: SampleSet | None = None
        self._cards: SampleCards | None = None
        self._adopted: int | None = None
        self._is_shown = False
        self._is_closed = False
        self._ranking: Ranking = "realism"
        self._pick: int | None = None
        self._pair = ScenePair(ui, noun="sample", use=self._adopt)
        self._overlay.on("samples", self._heard)
        self._model.checked.subscribe(self._show)
        self._show()

    @property
    def is_open(self) -> bool:
        """Whether the strip is on the page."""
        return self._is_shown and not self._is_closed and self._cards is not None

    def open(self, samples: SampleSet) -> None:
        """Show the samples of a new run as soon as their cards are computed."""
        self.forget()
        self._samples = samples
        post = self._ui.post
        BackgroundJob(
            "sample-cards",
            lambda _job: SampleCards.of(samples),
            lambda cards: post(lambda: self._computed(samples, cards)),
            lambda error: post(lambda: self._ui.report(error)),
        ).start()

    def follow(self, adopted: int | None, *, is_valid: bool) -> None:
        """Follow the session; samples that are not valid are hidden."""
        self._adopted, self._is_shown = adopted, is_valid
        self._show()

    def forget(self) -> None:
        """Remove the samples of the last run."""
        self._samples = self._cards = None
        self._pair.close()
        self._pick, self._is_closed = None, False
        self._point_at(None)
        self._show()

    def focus(self) -> None:
        """Open the strip again if it was closed, with the focus on its cards."""
        if self._can_open():
            self._is_closed = False
            self.opened.emit()
            self._show(takes_focus=True)

    def compare(self) -> None:
        """Compare the sample that is pointed at; without one, the sample in use.

        If a comparison is open, close it.
        """
        if self._pair.close() or not self._can_open():
            return
        self._is_closed = False
        self.opened.emit()
        self._show()
        assert self._cards is not None
        index = self._adopted
        for number, scenario in enumerate(self._cards.scenarios):
            if scenario is self._model.sample:
                index = number
        self._compare(self._order()[0] if index is None else index)

    def _can_open(self) -> bool:
        if self._cards is None or not self._is_shown:
            self._ui.notify(
                "No samples to choose among",
                "Set 'Samples' in the run bar to 2 or more, then regenerate or resample.",
            )
            return False
        return True

    def close(self) -> bool:
        """Close the comparison, or else the strip; returns whether one was open."""
        if self._pair.close():
            return True
        was_open, self._is_closed = self.is_open, True
        self._point_at(None)
        self._show()
        return was_open

    def _computed(self, samples: SampleSet, cards: SampleCards) -> None:
        if self._samples is samples:
            self._cards = cards
            self._show()
            if self.is_open:
                self.opened.emit()
                self._viewpoint.uncover()

    def _told(self) -> list[list[Finding]]:
        """What each card tells: findings that the user does not ignore."""
        assert self._cards is not None
        ignored = self._ui.session.variant.ignored
        return [
            [one for one in found if one.ignored_key not in ignored]
            for found in self._cards.findings
        ]

    def _ranked(self) -> tuple[int, ...]:
        assert self._cards is not None
        pairs = zip(self._cards.numbers, self._told(), strict=True)
        return ranked([one.counted(told) for one, told in pairs], self._ranking)

    def _order(self) -> list[int]:
        assert self._cards is not None
        order = self._ranked()
        if self._pick is None:
            return list(order)
        kept = set(self._cards.spread[: self._pick])
        return [index for index in order if index in kept]

    def _show(self, *, takes_focus: bool = False) -> None:
        self._model.covered["samples"] = COVERED_PX if self.is_open else 0
        if not self.is_open:
            self._pair.close()
            self._overlay.show(SamplesState())
            return
        cards, told = self._cards, self._told()
        assert cards is not None
        count = len(cards.numbers)
        rank = {index: number for number, index in enumerate(self._ranked(), 1)}
        pictures = {index: as_address(one) for index, one in enumerate(cards.pictures)}
        self._overlay.show(SamplePicturesState(pictures=pictures))
        sizes = {0: f"All {count}"}
        sizes |= {size: f"{size} most diverse" for size in PICKS if size < count}
        state = SamplesState(
            is_open=True,
            takes_focus=takes_focus,
            title=f"{count} samples",
            ranking=self._ranking,
            rankings=tuple(
                Choice(value=value, text=text) for value, text in RANKING_WORDS.items()
            ),
            pick=self._pick or 0,
            picks=tuple(Choice(value=size, text=text) for size, text in sizes.items()),
            cards=tuple(
                StripCard(
                    index=index,
                    name=_name(index),
                    mark="in use \N{MIDDLE DOT} " * (index == self._adopted)
                    + f"{rank[index]}.",
                    is_adopted=index == self._adopted,
                    lines=card_lines(told[index], cards.numbers[index], self._ranking),
                    hint=all_numbers(cards.numbers[index], told[index]),
                )
                for index in self._order()
            ),
        )
        self._overlay.show(state)

    def _heard(self, event: StripEvent) -> None:
        kind, value = event.kind, event.value
        if kind == "close":
            self.close()
        elif kind == "leave":
            self._point_at(None)
        elif kind == "rank" and value in RANKINGS:
            self._ranking = value
            self._show()
        elif kind == "pick" and isinstance(value, int):
            self._pick = value if value in PICKS else None
            self._show()
        elif isinstance(value, int) and self.is_open and self._has(value):
            if kind == "point":
                self._point_at(value)
            elif kind == "adopt":
                self._adopt(value)
            elif kind == "pair":
                self._compare(value)
            elif kind == "keep":
                self._adopt(value)
                self._model.save_requested.emit()

    def _has(self, index: int) -> bool:
        return self._cards is not None and 0 <= index < len(self._cards.numbers)

    def _adopt(self, index: int) -> None:
        self._model.sample = None
        self._pair.close()
        if index == self._adopted:
            self._model.sample_pointed.emit()
        else:
            self.adopted.emit(index)

    def _compare(self, index: int) -> None:
        """Show a sample beside the one in use, or that one beside the best other."""
        assert self._cards is not None
        scenarios = self._cards.scenarios
        offered = {one: (_name(one), scenarios[one]) for one in self._ranked()}
        self._pair.open(index, offered, self._cards.frame, adopted=self._adopted)

    def _point_at(self, index: int | None) -> None:
        cards = self._cards
        shown = None if index is None or cards is None else cards.scenarios[index]
        self._model.preview(shown)


def finding_lines(findings: Collection[Finding]) -> tuple[CardLine, CardLine]:
    """The number of problems, and their kinds."""
    problems = [one for one in findings if one.is_problem]
    count, notices = len(problems), len(findings) - len(problems)
    words = number_of(count, "problem", "No new")
    parts = _kinds_in_words(problems)[:2]
    if not parts:
        parts = [number_of(notices, "notice", "No")]
    tone = "bad" if count else ""
    return CardLine(text=words, tone=tone), CardLine(text=", ".join(parts))


def card_lines(
    findings: Collection[Finding], numbers: SampleNumbers, ranking: Ranking
) -> tuple[CardLine, ...]:
    """The three most telling lines of a sample: problems, their kinds, movement.

    With "interaction" the shortest time to collision replaces the movement.
    """
    time = numbers.time_to_collision_s
    if ranking == "interaction":
        last = (
            "no collision course"
            if time is None
            else f"{time:.{SECONDS_DIGITS}f} s to collision"
        )
    else:
        moving, speed = round(100 * numbers.moving_share), numbers.mean_speed_mps
        # A card is too narrow for two figures of three digits.
        share = "all" if moving == 100 else f"{moving} %"
        digits = 1 if speed < 9.95 else 0
        last = f"{share} move, {speed:.{digits}f} m/s"
    return *finding_lines(findings), CardLine(text=last)


def _name(index: int) -> str:
    return f"Sample {index + 1}"


def _kinds_in_words(problems: Iterable[Finding]) -> list[str]:
    """How many problems there are of each kind, such as "2 collisions"."""
    counts = Counter(_KINDS.get(one.kind, one.kind) for one in problems)
    order = dict.fromkeys((*_KINDS.values(), *counts))
    return [
        f"{counts[kind]} {kind}{'s' if kind == 'collision' and counts[kind] > 1 else ''}"
        for kind in order
        if counts[kind]
    ]


def all_numbers(numbers: SampleNumbers, findings: Iterable[Finding]) -> str:
    """Problems of all kinds and all numbers of a sample, one per line."""
    time = numbers.time_to_collision_s
    return "\n".join(
        (
            *_kinds_in_words(one for one in findings if one.is_problem),
            f"Realism {numbers.realism:.0f} of 100; a typical recording has 50",
            f"Agents: {numbers.num_agents}, of which collide: {numbers.num_collisions}",
            f"Time off-road, while moving: {numbers.off_road_share:.0%}",
            f"Distance to centre lines: {numbers.lateral_deviation_m:.1f} m",
            f"Moving: {numbers.moving_share:.0%}, at {numbers.mean_speed_mps:.1f} m/s",
            f"Uncomfortable: {numbers.harsh_share:.0%} of the time",
            "No agents on a collision course"
            if time is None
            else f"Shortest time to collision: {time:.1f} s",
        )
    )


def as_address(svg: str) -> str:
    """A picture as the source of an image."""
    return f"data:image/svg+xml;base64,{base64.b64encode(svg.encode()).decode()}"
