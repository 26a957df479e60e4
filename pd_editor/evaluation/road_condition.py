"""Road conditions of an evaluation: as recorded, or warped ahead of the focal agent."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from pd_editor.errors import InputError
from pd_editor.perturbation.anchor import pose_of_anchor
from pd_editor.perturbation.friction_limit import DRY_ROAD_FRICTION
from pd_editor.perturbation.warp_scenario import warp_scenario
from pd_editor.scene.road_warp import (
    DEFAULT_LENGTH_M,
    MAX_POWER,
    WARP_KINDS,
    RoadWarp,
    WarpTerm,
)
from pd_editor.scene.scenario import Scenario

PLAIN: Final = "none"
ALL_POWERS: Final = (3.0, 6.0, 9.0)


@dataclass(frozen=True, kw_only=True)
class RoadCondition:
    """A road as recorded, or one kind of warp at one power."""

    kind: str = PLAIN
    power: float = 0.0

    @property
    def label(self) -> str:
        """Label of the condition, as on the shell."""
        return PLAIN if self.is_plain else f"{self.kind}:{self.power:g}"

    @property
    def is_plain(self) -> bool:
        """Whether the road is the original one."""
        return self.kind == PLAIN

    def applied_to(self, scenario: Scenario) -> Scenario:
        """Apply the condition to a scenario: map, states and recorded trajectories.

        As in Scene-Attack, agents are slowed to the friction limit of a dry road, so that
        recorded trajectories stay drivable.

        Raises:
            EditError: the scenario has no focal agent at its current step.
        """
        for kind in WARP_KINDS:
            if kind == self.kind:
                term = WarpTerm(
                    kind=kind, power=self.power, length_m=DEFAULT_LENGTH_M[kind]
                )
                anchor = pose_of_anchor(scenario, "focal")
                return warp_scenario(
                    scenario,
                    RoadWarp(anchor=anchor, terms=(term,)),
                    friction_coefficient=DRY_ROAD_FRICTION,
                )
        return scenario


ALL_CONDITIONS: Final = (
    RoadCondition(),
    *(RoadCondition(kind=k, power=p) for k in WARP_KINDS for p in ALL_POWERS),
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
    kind, colon, power = text.partition(":")
    if kind == PLAIN and not colon:
        return RoadCondition()
    try:
        value = float(power)
    except ValueError:
        value = 0.0
    if kind not in WARP_KINDS or not 0 < abs(value) <= MAX_POWER:
        raise InputError(
            f"Warp {text[:60]!r} is not known; expected none, all, or KIND:POWER with "
            f"a kind among {', '.join(WARP_KINDS)} and a power in -10..10 other than 0."
        )
    return RoadCondition(kind=kind, power=value)
