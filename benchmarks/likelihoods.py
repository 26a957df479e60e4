"""The meta-metric's ceiling: recordings, as they are and smoothed, against themselves.

Positions and headings are smoothed over time by a Gaussian, so that what tracking adds goes:
what moves as vehicles can is at most as likely. Scenes of a split of PD_EDITOR_AV2.
"""

import argparse
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d

from pd_editor.analysis.metrics.likelihoods import (
    LIKELIHOODS,
    likelihood_values,
    meta_metric,
)
from pd_editor.analysis.metrics.traffic_view import TrafficView
from pd_editor.editor.scenario_store import scene_part
from pd_editor.experiments.evaluation.evaluation_task import DRIVING
from pd_editor.experiments.evaluation.method import GROUND_TRUTH, Method
from pd_editor.generation.generators import make_generator
from pd_editor.scene.scene_cut import COMPARED

WIDTHS_S = (0.0, 0.1, 0.2, 0.4)


def smoothed(view: TrafficView, width_s: float) -> TrafficView:
    """The recording, smoothed, against what was recorded."""
    agents = view.logged
    position = agents.position_m.astype(float)
    heading = np.unwrap(agents.heading_rad.astype(float), axis=1)
    for row in range(len(position)) if width_s else ():
        there = agents.is_valid[row]
        for values in (position, heading):
            values[row, there] = gaussian_filter1d(
                values[row, there], width_s / view.step_s, axis=0, mode="nearest"
            )
    moved = replace(agents, position_m=position, heading_rad=heading)
    return replace(view, agents=moved, logged=agents)


def main() -> None:
    """Print a row for each width."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--split", default="val")
    options = parser.parse_args()
    log = Method(name=GROUND_TRUTH, make_generator=make_generator)
    found: dict[float, list[list[float]]] = {width: [] for width in WIDTHS_S}
    for folder in sorted(
        (Path(os.environ["PD_EDITOR_AV2"]) / options.split).glob("*/")
    ):
        scene = scene_part(folder, COMPARED)
        request = DRIVING.request(scene, scene, num_samples=1, seed=0)
        (view,) = log.traffic(request).samples
        for width, rows in found.items():
            values = likelihood_values([smoothed(view, width)])
            mean = {
                name: one.value[one.is_valid].mean() for name, one in values.items()
            }
            rows.append([float(meta_metric(mean)), *np.exp(list(mean.values()))])
    print("smoothed  meta-metric  " + "  ".join(name[14:] for name in LIKELIHOODS))
    for width, rows in found.items():
        print(
            f"{width:g} s  " + "  ".join(f"{one:.2f}" for one in np.mean(rows, axis=0))
        )


if __name__ == "__main__":
    main()
