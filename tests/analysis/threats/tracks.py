"""Tracks of single trajectories for tests of threats."""

from dataclasses import replace

from pd_editor.analysis.threats.encounter import Track


def only_one(tracks: Track) -> Track:
    """The only one of N = 1 trajectories."""
    assert len(tracks.position_m) == 1
    return replace(
        tracks,
        position_m=tracks.position_m[0],
        heading_rad=tracks.heading_rad[0],
        velocity_mps=tracks.velocity_mps[0],
    )
