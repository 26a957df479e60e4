"""The rule-based baseline generator: follow a lane, keep a gap, give way."""

from pd_editor.lane_follower.lane_follower import LaneFollower

__all__ = ["LaneFollower"]
