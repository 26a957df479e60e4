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
    goal_way_m: float = 2.0
    """Accepted deviation from a smooth way to a goal point."""
    path_m: float = 0.3
    """Accepted distance to the side of a path; of a prediction that is retimed, twice as
    much."""
    pace_m: float = 1.5
    """Accepted deviation along a path, where only its course is asked for."""
    speed_m: float = 0.4
    """Accepted deviation along a path in the time that speeds are asked for."""
    speed_mps: float = 0.3
    """Accepted deviation of these speeds."""
    comfort_mps2: float = 0.05
    """Accepted deviation of accelerations from their limits, below which agents are asked
    to stay by twice as much."""
    stop_m: float = 0.1
    """Accepted deviation from a stopping trajectory, and from the gap to the agent
    ahead."""
    stop_mps: float = 0.1
    """Accepted deviation of speeds on a stopping trajectory."""
    stop_gap_m: float = 0.4
    """Gap between the front of a stopped agent and the line."""
    acceleration_mps2: float = 1.5
    """Acceleration towards a target speed, if that is enough."""
    braking_mps2: float = 2.0
    """Braking to a target speed, a limit or a line, if that is enough."""
    hard_braking_mps2: float = 3.5
    """Braking to a line, if it takes that to stand within the time."""
    limit_margin_mps: float = 0.2
    """How far below a speed limit agents are asked to stay."""
    box_m: float = 0.05
    """Accepted deviation from where boxes are apart, or meet."""
    avoided_aside_m: float = 0.3
    """Gap to the side that is asked for between boxes; ahead, twice as much."""
    led_weight: float = 0.1
    """Weight of avoiding collisions of agents that are led to a goal or along a path.
    Without it, they drive through agents that stand in the way."""
    max_swerve_m: float = 2.5
    """Agents swerve by no more to avoid a collision."""
    hardest_mps2: float = 7.0
    """Agents are not asked to brake harder to let others pass."""
    yield_gap_m: float = 1.0
    """Gap to what the other agent will block, of an agent that yields."""
    threat_m: float = 0.5
    """Accepted deviation from the plan of a threat, before the meeting."""

    def __post_init__(self) -> None:
        check_settings(self)
