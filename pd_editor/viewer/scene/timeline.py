"""The timeline under the picture: play, scrub, step, speed, loop."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final, Literal

from pd_editor.editor.commands import BeginAt
from pd_editor.viewer.overlay.messages import (
    PlayheadState,
    TimelineEvent,
    TimelineMark,
    TimelineState,
)
from pd_editor.viewer.overlay.overlay import STATE
from pd_editor.viewer.state.events import Signal
from pd_editor.viewer.state.playback import Playback
from pd_editor.viewer.tab.ui_context import UiContext

MAX_MARK_LINES: Final = 4


MarkKind = Literal["problem", "notice", "finding"]


@dataclass(frozen=True, kw_only=True)
class Mark:
    """A mark of problems or of findings on the track."""

    step: int
    text: str
    """Shown when the pointer is over it; lines are kept."""


def marks_of(lines: Iterable[tuple[int, str]]) -> tuple[Mark, ...]:
    """One mark per step with the texts of that step, of which only some are shown."""
    by_step: dict[int, list[str]] = {}
    for step, text in lines:
        by_step.setdefault(step, []).append(text)
    marks = []
    for step, texts in sorted(by_step.items()):
        more = len(texts) - MAX_MARK_LINES
        shown = texts[:MAX_MARK_LINES] + ([f"... and {more} more"] if more > 0 else [])
        marks.append(Mark(step=step, text="\n".join(shown)))
    return tuple(marks)


class Timeline:
    """The element ``timeline``, whose axis and marks change seldom, and its playhead.

    The page moves the playhead by itself between two calls of ``show``, so that it runs
    smoothly; the time of ``Playback`` is authoritative.
    """

    def __init__(self, ui: UiContext) -> None:
        """Show it; the banner shows the picture's time while it differs from t = 0."""
        self._ui, self._overlay, self._banner = ui, ui.overlay, ui.banner
        self._playback = ui.workspace.playback
        self._moved = ui.model.playhead_moved
        self._marks: dict[MarkKind, tuple[Mark, ...]] = {}
        self.mark_chosen: dict[MarkKind, Signal[int]] = {
            "problem": Signal(),
            "notice": Signal(),
            "finding": Signal(),
        }
        """The step of a mark that the user has clicked."""
        self._overlay.on("timeline", self._heard)
        self._moved.subscribe(self.show)
        ui.model.shown.subscribe(self.show)

    def toggle_play(self) -> None:
        """Play or pause."""
        if self._playback.is_playing:
            self._playback.pause()
        else:
            self._playback.play()
        self.show()

    def shuttle(self, direction: int) -> None:
        """Play in a direction, or faster if it plays in it already; 0 pauses."""
        self._playback.shuttle(direction)
        self.show()

    def go_to_current(self) -> None:
        """Stop at the current step, where edits act."""
        self.seek(float(self._playback.axis.current_step))

    def start_here(self) -> None:
        """Make the moment that is shown the current step."""
        axis = self._playback.axis
        steps = round(self._playback.step) - axis.current_step
        time_s = round(steps * axis.step_s, 6)
        self._ui.apply(BeginAt(time_s=time_s, keeps_guidance=True))

    def seek(self, step: float) -> None:
        """Stop at a step."""
        self._playback.pause()
        self._playback.seek(step)
        self._moved.emit()

    def step_by(self, steps: int) -> None:
        """Stop some whole steps further on, or back."""
        self.seek(round(self._playback.step) + steps)

    def set_marks(self, kind: MarkKind, marks: tuple[Mark, ...]) -> None:
        """Mark problems, or findings of the scorecard, on the track."""
        if marks != self._marks.get(kind, ()):
            self._marks[kind] = marks
            self.show()

    def show(self) -> None:
        """Show the axis and the playhead as they are."""
        playback = self._playback
        axis = playback.axis
        now = axis.current_step
        track = TimelineState(
            first_step=-now,
            last_step=axis.num_steps - 1 - now,
            begin_step=playback.first_step - now,
            end_step=playback.last_step - now,
            step_s=axis.step_s,
            marks=tuple(
                TimelineMark(kind=kind, step=mark.step - now, text=mark.text)
                for kind, mark in self._shown_marks()
            ),
        )
        head = PlayheadState(
            step=round(playback.step - now, 4),
            is_playing=playback.is_playing,
            speed=playback.direction * playback.speed,
            loops=playback.loops,
        )
        self._overlay.show(track)
        self._overlay.show(head)
        self._show_banner()

    def _shown_marks(self) -> list[tuple[MarkKind, Mark]]:
        """All marks; at the step of a problem, its mark stands for the findings."""
        findings = {mark.step: mark for mark in self._marks.get("finding", ())}
        shown: list[tuple[MarkKind, Mark]] = [
            ("notice", mark) for mark in self._marks.get("notice", ())
        ]
        for mark in self._marks.get("problem", ()):
            also = findings.pop(mark.step, None)
            text = mark.text if also is None else f"{mark.text}\n{also.text}"
            shown.append(("problem", replace(mark, text=text)))
        return [*(("finding", mark) for mark in findings.values()), *shown]

    def _show_banner(self) -> None:
        """Show in the banner that edits act at another time than the picture's."""
        playback = self._playback
        time_s = (playback.step - playback.axis.current_step) * playback.axis.step_s
        # Nearer to t = 0 the picture shows the state that edits act on.
        if playback.is_playing or abs(time_s) < 0.005:
            self._banner.hide("time")
            return
        self._banner.show(
            "time",
            f"You see t = {in_seconds(time_s)}; edits in the picture act at t = 0 s.",
            buttons={
                "Go to t = 0": self.go_to_current,
                "Start from here": self.start_here,
            },
            priority=STATE,
        )

    def _heard(self, event: TimelineEvent) -> None:
        """Do what the user asked for; numbers of any size are clamped."""
        playback = self._playback
        kind, value = event.kind, event.value
        if kind == "play":
            self.toggle_play()
        elif kind == "current":
            self.go_to_current()
        elif kind == "seek":
            self.seek(float(_within(playback.axis.current_step + value, playback)))
        elif kind == "step":
            self.step_by(_within(value, playback))
        elif kind == "speed":
            playback.next_speed()
            self.show()
        elif kind == "loop":
            playback.loops = not playback.loops
            self.show()
        else:
            step = _within(playback.axis.current_step + value, playback)
            self.mark_chosen[kind].emit(step)


def in_seconds(time_s: float) -> str:
    """A time as the page shows it, with a true minus sign."""
    sign = "\u2212" if time_s < -0.05 else ""
    return f"{sign}{abs(time_s):.1f} s"


def _within(steps: int, playback: Playback) -> int:
    """A number of steps that a float can hold."""
    limit = playback.axis.num_steps
    return max(-limit, min(steps, limit))
