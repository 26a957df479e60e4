"""Commands for the road and the signals of its junctions."""

import math
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar, Final

from pd_editor.base.errors import EditError
from pd_editor.editor.commands.command import Command
from pd_editor.editor.commands.edit_limits import check_anchor, check_friction
from pd_editor.scene.generation import MAX_SEED
from pd_editor.scene.junction_phases import sampled_signals, signals_with_green
from pd_editor.scene.perturbation.warp_scenario import warp_scenario
from pd_editor.scene.road_warp import RoadWarp, WarpKind, WarpTerm
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.signals import Signal

WARP_NAME: Final[dict[WarpKind, str]] = {
    "smooth-turn": "bend",
    "double-turn": "S-bend",
    "ripple-road": "waves",
}
"""Everyday names of the kinds of warp."""


@dataclass(frozen=True, kw_only=True)
class SetRoadWarp(Command):
    """Warp the original road, or restore it; replaces an earlier warp."""

    is_beyond_locks: ClassVar[bool] = True

    warp: RoadWarp | None
    friction_coefficient: float | None = None
    """Friction coefficient mu that agents are slowed to; None leaves their speeds."""

    def __post_init__(self) -> None:
        if self.friction_coefficient is not None:
            check_friction(self.friction_coefficient)
        if self.warp is not None:
            check_anchor(self.warp.anchor)

    @property
    def label(self) -> str:
        """Label with kinds and powers of the terms."""
        if self.warp is None or self.warp.is_identity:
            return "Reset the road"
        bends = ", ".join(
            f"{WARP_NAME[term.kind]} {term.power:+g}" for term in _bends(self.warp)
        )
        mu = self.friction_coefficient
        return f"Bend the road: {bends}" + ("" if mu is None else f", friction {mu:g}")

    def label_after(self, before: Scenario) -> str:
        """Label with the differences to the applied warp."""
        applied = before.applied_warp
        if applied is None or self.warp is None or self.warp.is_identity:
            return self.label
        changes = [
            *_anchor_changes(applied.warp, self.warp),
            *_bend_changes(applied.warp, self.warp),
            *_friction_changes(applied.friction_coefficient, self.friction_coefficient),
        ]
        return f"Road: {', '.join(changes)}" if changes else self.label

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario under this warp only."""
        applied = scenario.applied_warp
        if applied is None and (self.warp is None or self.warp.is_identity):
            return scenario
        if applied is not None and (
            (applied.warp, applied.friction_coefficient)
            == (self.warp, self.friction_coefficient)
            and applied.warped_agents is scenario.agents
        ):
            return scenario
        return warp_scenario(
            scenario, self.warp, friction_coefficient=self.friction_coefficient
        )


def _bends(warp: RoadWarp) -> tuple[WarpTerm, ...]:
    """Terms with a power other than zero."""
    return tuple(term for term in warp.terms if term.power != 0)


def _anchor_changes(before: RoadWarp, after: RoadWarp) -> Iterator[str]:
    one, other = before.anchor, after.anchor
    distance = math.hypot(other.x_m - one.x_m, other.y_m - one.y_m)
    if distance >= 0.05:
        yield (
            f"anchor moved {distance:.1f} m"
            if distance < 10
            else (f"anchor moved {distance:.0f} m")
        )
    turn = math.degrees(
        math.remainder(other.rotation_rad - one.rotation_rad, 2 * math.pi)
    )
    if abs(turn) >= 0.5:
        yield f"anchor turned {turn:+.0f}°"


def _bend_changes(before: RoadWarp, after: RoadWarp) -> Iterator[str]:
    old = {term.kind: term for term in _bends(before)}
    new = {term.kind: term for term in _bends(after)}
    for kind, name in WARP_NAME.items():
        if kind in old and kind in new:
            one, other = old[kind], new[kind]
            if one.power != other.power:
                yield f"{name} {one.power:+g} to {other.power:+g}"
            if one.length_m != other.length_m:
                yield f"length of the {name} {one.length_m:g} to {other.length_m:g} m"
        elif kind in new:
            yield f"{name} {new[kind].power:+g} added"
        elif kind in old:
            yield f"{name} taken away"
    yield from _shape_changes(tuple(old.values()), tuple(new.values()))


def _shape_changes(
    old: tuple[WarpTerm, ...], new: tuple[WarpTerm, ...]
) -> Iterator[str]:
    """Changes of border and exponent, which are common to all terms."""
    if not (old and new):
        return
    if old[0].border_m != new[0].border_m:
        yield f"starts after {old[0].border_m:g} to {new[0].border_m:g} m"
    if old[0].exponent != new[0].exponent:
        yield f"sharpness {old[0].exponent:g} to {new[0].exponent:g}"


def _friction_changes(before: float | None, after: float | None) -> Iterator[str]:
    if before is None and after is not None:
        yield f"friction limit {after:g}"
    elif before is not None and after is None:
        yield "friction limit off"
    elif before != after:
        yield f"friction {before:g} to {after:g}"


class _SignalCommand(Command):
    """A command that changes signals alone."""

    is_beyond_locks: ClassVar[bool] = True

    @abstractmethod
    def signals(self, scenario: Scenario) -> tuple[Signal, ...]:
        """Signals that the scenario has afterwards."""

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario with these signals."""
        return replace(scenario, signals=self.signals(scenario))


@dataclass(frozen=True, kw_only=True, eq=False)
class SampleSignals(_SignalCommand):
    """Sample a plausible phase of each junction; replaces earlier signals."""

    seed: int = 0

    def __post_init__(self) -> None:
        if not 0 <= self.seed <= MAX_SEED:
            raise EditError(f"The seed is {self.seed}; expected 0 to {MAX_SEED}.")

    @property
    def label(self) -> str:
        """Label with the seed."""
        return f"Sample signals, seed {self.seed}"

    def signals(self, scenario: Scenario) -> tuple[Signal, ...]:
        """Signals of all junctions."""
        found = sampled_signals(scenario, self.seed)
        if not found:
            raise EditError(
                "No junction of this map has lanes that cross; expected one for signals."
            )
        return found


@dataclass(frozen=True, kw_only=True, eq=False)
class GiveGreen(_SignalCommand):
    """Give a lane green, and the other lanes of its junction what its phase tells."""

    lane_id: int

    @property
    def label(self) -> str:
        """Label with the lane."""
        return f"Green for lane {self.lane_id}"

    def signals(self, scenario: Scenario) -> tuple[Signal, ...]:
        """Signals after the change."""
        found = signals_with_green(scenario, self.lane_id)
        if found is None:
            raise EditError(
                f"Lane {self.lane_id} leads into no junction with lanes that cross; "
                "expected a lane of one, or before one."
            )
        return found


@dataclass(frozen=True, kw_only=True, eq=False)
class RemoveSignals(_SignalCommand):
    """Remove all signals."""

    @property
    def label(self) -> str:
        """Short text."""
        return "Remove signals"

    def apply(self, scenario: Scenario) -> Scenario:
        """Scenario without signals."""
        return super().apply(scenario) if scenario.signals else scenario

    def signals(self, scenario: Scenario) -> tuple[Signal, ...]:  # noqa: ARG002
        """None at all."""
        return ()
