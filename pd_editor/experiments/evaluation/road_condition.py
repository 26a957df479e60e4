"""Road conditions: as recorded, or warped ahead of an anchor by a sum of warps."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from pd_editor.base.errors import InputError
from pd_editor.base.plain_text import nearest_or_all
from pd_editor.scene.perturbation.friction import DRY_ROAD_FRICTION
from pd_editor.scene.perturbation.warp_scenario import pose_of_anchor, warp_scenario
from pd_editor.scene.road_warp import (
    DEFAULT_LENGTH_M,
    MAX_POWER,
    WARP_KINDS,
    RoadWarp,
    WarpKind,
    WarpTerm,
)
from pd_editor.scene.scenario import Scenario

PLAIN: Final = "none"
ALL_POWERS: Final = (3.0, 6.0, 9.0)
DEFAULT_ANCHOR: Final = "focal"
ANCHORS: Final = (DEFAULT_ANCHOR, "ego")


@dataclass(frozen=True, kw_only=True)
class RoadCondition:
    """A road as recorded, or warped by a sum of warps ahead of an anchor."""

    terms: tuple[tuple[WarpKind, float], ...] = ()
    """Kinds and powers of the warps; none: the road as recorded."""
    anchor: str = DEFAULT_ANCHOR
    """One of ``ANCHORS``."""

    @property
    def label(self) -> str:
        """Label of the condition, as on the shell: ``smooth-turn:3+ripple-road:-2@ego``."""
        if self.is_plain:
            return PLAIN
        at = "" if self.anchor == DEFAULT_ANCHOR else f"@{self.anchor}"
        return _sum_of(self.terms) + at

    @property
    def kind(self) -> str:
        """Kind of the warp; the whole label of a sum or of another anchor."""
        is_single = len(self.terms) == 1 and self.anchor == DEFAULT_ANCHOR
        return self.terms[0][0] if is_single else self.label

    @property
    def family(self) -> str:
        """What conditions of other powers share with this one, besides the anchor."""
        if self.is_plain:
            return PLAIN
        if len(self.terms) == 1:
            return self.terms[0][0]
        return _sum_of(self.terms)

    @property
    def power(self) -> float:
        """Power of the strongest warp, with its sign; 0 for the original road."""
        return max((power for _, power in self.terms), key=abs, default=0.0)

    @property
    def is_plain(self) -> bool:
        """Whether the road is the original one."""
        return not self.terms

    def warp_of(self, scenario: Scenario) -> RoadWarp:
        """The warp of a scenario's original road.

        Raises:
            EditError: the anchor is not in the scenario at its current step.
        """
        return RoadWarp(
            anchor=pose_of_anchor(scenario, self.anchor),
            terms=tuple(
                WarpTerm(kind=kind, power=power, length_m=DEFAULT_LENGTH_M[kind])
                for kind, power in self.terms
            ),
        )

    def applied_to(
        self, scenario: Scenario, friction_coefficient: float | None = DRY_ROAD_FRICTION
    ) -> Scenario:
        """Apply the condition to a scenario: map, states and recorded trajectories.

        As in Scene-Attack, agents are slowed to the friction limit of a dry road, so that
        recorded trajectories stay drivable.

        Raises:
            EditError: the anchor is not in the scenario at its current step.
        """
        if self.is_plain:
            return scenario
        return warp_scenario(
            scenario, self.warp_of(scenario), friction_coefficient=friction_coefficient
        )


def _sum_of(terms: tuple[tuple[WarpKind, float], ...]) -> str:
    return "+".join(f"{kind}:{power:g}" for kind, power in terms)


ALL_CONDITIONS: Final = (
    RoadCondition(),
    *(RoadCondition(terms=((k, p),)) for k in WARP_KINDS for p in ALL_POWERS),
)
"""The original road, and Scene-Attack's three kinds of warps at three powers."""


def road_conditions(texts: Iterable[str]) -> tuple[RoadCondition, ...]:
    """Parse conditions from the shell: ``none``, ``smooth-turn:3``, ``all``.

    Raises:
        InputError: a text is not a condition.
    """
    found: dict[RoadCondition, None] = {}
    for text in texts:
        if text == "all":
            found |= dict.fromkeys(ALL_CONDITIONS)
        else:
            found[_parsed(text)] = None
    if not found:
        raise InputError(
            "No road condition was given; expected none, all, or KIND:POWER."
        )
    return tuple(found)


def _parsed(text: str) -> RoadCondition:
    if text == PLAIN:
        return RoadCondition()
    sum_text, at, anchor = text.partition("@")
    terms = [_term(part) for part in re.split(r"\+(?=[a-z])", sum_text)]
    known = [term for term in terms if term is not None]
    _check_kinds(text, sum_text)
    kinds = {kind for kind, _ in known}
    anchor = anchor if at else DEFAULT_ANCHOR
    if len(known) < len(terms) or len(kinds) < len(terms) or anchor not in ANCHORS:
        raise InputError(
            f"Warp {text[:60]!r} is not known; expected none, all, KIND:POWER with a kind "
            f"among {', '.join(WARP_KINDS)} and a power in -10..10 other than 0, or a sum "
            "such as smooth-turn:3+ripple-road:-2; @ego at its end warps ahead of the ego "
            "vehicle instead of the focal agent."
        )
    return RoadCondition(terms=tuple(known), anchor=anchor)


def _check_kinds(text: str, sum_text: str) -> None:
    """Raise for a kind that is spelt nearly like one."""
    for name in re.findall(r"[a-z][a-z-]+", sum_text):
        told = nearest_or_all(name, WARP_KINDS)
        if name not in WARP_KINDS and told.startswith("the nearest"):
            raise InputError(
                f"Warp {text[:60]!r} is not known; {told}, such as {WARP_KINDS[0]}:3."
            )


def _term(text: str) -> tuple[WarpKind, float] | None:
    """Kind and power; None if the text is neither."""
    name, _, power = text.partition(":")
    try:
        value = float(power)
    except ValueError:
        return None
    for kind in WARP_KINDS:
        if kind == name and 0 < abs(value) <= MAX_POWER:
            return kind, value
    return None
