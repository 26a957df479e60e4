"""Settings of guidance terms, stored with a model."""

from dataclasses import dataclass

from pd_editor.generation.core.config_limits import check_settings


@dataclass(frozen=True, kw_only=True)
class TermGuidance:
    """Strengths, accepted deviations and schedule of guidance terms."""

    spread: float = 0.15
    """How far latents may leave a prediction of low noise, in standard deviations."""
    spread_of_noise: float = 0.5
    """What is added to the spread at noise level 1; proportional to the level."""
    num_closings: int = 2
    """Projections of the result to the terms that are closed; three times as many if
    collisions are avoided: one agent that makes way may be in the way of another."""
    goal_m: float = 0.2
    """Accepted distance to a goal point, and of a box's corner to the road, inside of
    which it is asked to be by as much."""
    path_m: float = 0.3
    """Accepted distance to the side of a path; of a prediction that is retimed, twice as
    much."""
    speed_mps: float = 0.3
    """Accepted deviation of speeds, and along a path in their time in m; agents are asked
    to stay below a speed limit by as much."""
    stop_m: float = 0.1
    """Accepted deviation from a stopping trajectory, in m and m/s, and from the gap to the
    agent ahead."""
    box_m: float = 0.05
    """Accepted deviation from what is not to be crossed: m from where boxes are apart, or
    meet; m/s2 from limits of accelerations, below which agents are asked to stay by twice
    as much."""
    led_weight: float = 0.1
    """Weight of avoiding collisions of agents that are led to a goal or along a path.
    Without it, they drive through agents that stand in the way."""
    max_swerve_m: float = 2.5
    """Agents swerve by no more to avoid a collision."""

    def __post_init__(self) -> None:
        check_settings(self)

    @property
    def goal_way_m(self) -> float:
        """Accepted deviation from a smooth way to a goal point."""
        return 10 * self.goal_m

    @property
    def pace_m(self) -> float:
        """Accepted deviation along a path, where only its course is asked for."""
        return 5 * self.path_m

    @property
    def threat_m(self) -> float:
        """Accepted deviation from the plan of a threat, before the meeting."""
        return 10 * self.box_m
