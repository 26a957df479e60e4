"""What a demo is made from."""

from dataclasses import dataclass

from pd_editor.experiments.synthesis.traffic.demand_config import DemandOptions


@dataclass(frozen=True, kw_only=True)
class Story:
    """A window of simulated traffic that was picked by eye; equal ones look alike."""

    name: str
    """Of the demo: its folder and scenario id."""
    sentence: str
    """What it shows."""
    family: str
    """Of the procedural roads."""
    seed: int
    """Of the roads and the traffic."""
    demand: DemandOptions
    current_step: int
    """Step of the simulation that becomes the demo's current one."""
    focal_id: str
    """Agent of the simulation that the demo is about."""
    duration_s: float = 50.0
    """Of the simulation; another one has other traffic."""
    cast_seed: int = 0
    """Draws the ego and the scored agents."""
    side_m: float = 140.0
    """Side of the square about the focal agent whose agents are shown."""
    without: tuple[str, ...] = ()
    """Agents of the simulation that are left out: not quite on the paved ground."""
