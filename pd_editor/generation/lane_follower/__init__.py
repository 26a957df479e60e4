"""Rule-based baseline generator: lane following, car following and yielding."""

from pd_editor.generation.lane_follower.lane_follower import LaneFollower

__all__ = ["LaneFollower"]
