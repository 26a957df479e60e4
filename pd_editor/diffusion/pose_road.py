"""How far agents are from the road, and which way it is."""

import math
from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pd_editor.diffusion.pose_features import turned, turned_back
from pd_editor.diffusion.scene_tensors import SceneTensors
from pd_editor.metrics.off_lane import OFF_LANE_M
from pd_editor.windows.lane_pieces import CROSSWALK_KIND, PIECE_LENGTH_M
from pd_editor.windows.scene_features import AGENT_KINDS

_PEDESTRIAN: Final = len(AGENT_KINDS) - 1


def is_on_road(scene: SceneTensors) -> Bool[Tensor, "B A"]:
    """Whether agents are within ``OFF_LANE_M`` of a centre line, by the paper's rule."""
    return offset_from_lane_m(scene.agent_pose[..., :2], scene)[1] <= OFF_LANE_M


def follows_lanes(scene: SceneTensors) -> Bool[Tensor, "B A"]:
    """All but pedestrians, where there are lanes."""
    has_lanes = (scene.has_piece & (scene.piece_kind != CROSSWALK_KIND)).any(dim=-1)
    return scene.has_agent & (scene.agent_kind != _PEDESTRIAN) & has_lanes[:, None]


def offset_from_lane_m(
    position_m: Float[Tensor, "*s B A 2"], scene: SceneTensors
) -> tuple[Float[Tensor, "*s B A 2"], Float[Tensor, "*s B A"]]:
    """Vector from the nearest point of a centre line to each position; its length.

    Pieces of lanes count as straight. The length is infinite where there is no lane.
    """
    heading = scene.piece_pose[..., 2]
    axis = torch.stack([heading.cos(), heading.sin()], dim=-1)[:, None]
    offset = position_m[..., None, :] - scene.piece_pose[:, None, :, :2]
    along, aside = turned_back(offset, axis.expand_as(offset)).unbind(-1)
    half_m = scene.piece_shape[:, None, :, 0] * (PIECE_LENGTH_M / 2)
    beyond = along - torch.minimum(torch.maximum(along, -half_m), half_m)
    gap = torch.stack([beyond, aside], dim=-1)
    usable = scene.has_piece & (scene.piece_kind != CROSSWALK_KIND)
    distance = gap.norm(dim=-1).masked_fill(~usable[:, None], math.inf)
    nearest_m, nearest = distance.min(dim=-1)
    back = turned(gap, axis.expand_as(gap))
    index = nearest[..., None, None].expand(*nearest.shape, 1, 2)
    return back.gather(-2, index)[..., 0, :], nearest_m
