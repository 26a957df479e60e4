"""Settings of guidance terms, stored with a model."""

from dataclasses import dataclass

from pd_editor.generation.core.config_limits import check_settings


@dataclass(frozen=True, kw_only=True)
class TermGuidance:
    """Strengths, accepted deviations and schedule of guidance terms."""

    first_level: float = 1.0
    """There is no guidance above this noise level."""
    is_last_step_guided: bool = False
    """Whether the prediction of the last denoising step is guided like the others."""
    spread: float = 0.15
    """How far latents may leave a prediction of low noise, in standard deviations."""
    spread_of_noise: float = 0.5
    """What is added to the spread at noise level 1; proportional to the level."""
    num_closings: int = 2
    """Projections of the result to the terms that are closed."""
    num_avoiding: int = 4
    """Further projections if collisions are avoided: one agent that makes way may be in
    the way of another."""
    closing_spread: float = 0.3
    """The spread in these projections."""
    goal_m: float = 0.2
    """Accepted distance to a goal point."""
    goal_way_m: float = 2.0
    """Accepted deviation from a smooth way to a goal point."""
    goal_aside_m: float = 4.0
    """Farthest that a goal point may be beside a path."""
    path_m: float = 0.3
    """Accepted distance to the side of a path."""
    pace_m: float = 1.5
    """Accepted deviation along a path, where only its course is asked for."""
    speed_m: float = 0.4
    """Accepted deviation along a path in the time that speeds are asked for."""
    speed_mps: float = 0.3
    """Accepted deviation of these speeds."""
    comfort_mps2: float = 0.05
    """Accepted deviation of accelerations from their limits."""
    comfort_margin_mps2: float = 0.1
    """How far below limits of acceleration agents are asked to stay."""
    held_path_m: float = 0.6
    """Accepted deviation to the side of a prediction that is retimed."""
    stop_m: float = 0.1
    """Accepted deviation from a stopping trajectory."""
    stop_mps: float = 0.1
    """Accepted deviation of speeds on a stopping trajectory."""
    stop_gap_m: float = 0.4
    """Gap between the front of a stopped agent and the line."""
    road_m: float = 0.2
    """Accepted distance of a box's corner outside the road."""
    road_margin_m: float = 0.2
    """Distance that corners are asked to have from the edge of the road."""
    acceleration_mps2: float = 1.5
    """Acceleration towards a target speed, if that is enough."""
    braking_mps2: float = 2.0
    """Braking to a target speed, a limit or a line, if that is enough."""
    hard_braking_mps2: float = 3.5
    """Braking to a line, if it takes that to stand within the time."""
    max_acceleration_mps2: float = 2.5
    """Highest acceleration that guidance asks for."""
    max_braking_mps2: float = 5.0
    """Highest braking that guidance asks for."""
    lateral_mps2: float = 3.0
    """Lateral acceleration up to which paths are followed."""
    limit_margin_mps: float = 0.2
    """How far below a speed limit agents are asked to stay."""
    box_m: float = 0.05
    """Accepted deviation from where boxes are apart."""
    avoided_aside_m: float = 0.3
    """Gap to the side that is asked for between boxes."""
    avoided_ahead_m: float = 0.6
    """Gap ahead that is asked for between boxes."""
    led_weight: float = 0.1
    """Weight of avoiding collisions of agents that are led to a goal or along a path.
    Without it, they drive through agents that stand in the way: on ``train`` 19 % more
    collisions than unguided."""
    max_swerve_m: float = 2.5
    """Agents swerve by no more to avoid a collision."""
    hardest_mps2: float = 7.0
    """Agents are not asked to brake harder to let others pass."""
    yield_gap_m: float = 1.0
    """Gap to what the other agent will block, of an agent that yields."""
    gap_m: float = 0.1
    """Accepted deviation from the gap to the agent ahead."""
    threat_m: float = 0.5
    """Accepted deviation from the plan of a threat."""
    threat_meeting_m: float = 0.05
    """The same around the meeting."""

    def __post_init__(self) -> None:
        check_settings(self)
