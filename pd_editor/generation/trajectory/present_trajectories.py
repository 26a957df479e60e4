"""Trajectories of a scenario before an edit, as noise from which they are continued."""

from dataclasses import replace
from typing import Final

import numpy as np
import torch

from pd_editor.generation.trajectory.continuation import Continuation, inverted_noise
from pd_editor.generation.trajectory.pipeline import (
    TrajectoryOptions,
    TrajectorySampling,
    sampled_from,
)
from pd_editor.generation.trajectory.sampler import KnownNoise, TrajectoryModel
from pd_editor.generation.trajectory.task import TrajectoryTask
from pd_editor.scene.scenario import Scenario

_MOST_SAMPLES: Final = 4
"""Number of settings whose samples are kept."""


class PresentTrajectories:
    """Noise of the trajectories of a scenario, and samples from it.

    Both are computed once, for all continuations: the frames of a drag, and its result.
    """

    def __init__(
        self, model: TrajectoryModel, scenario: Scenario, agent_ids: tuple[str, ...]
    ) -> None:
        """Compute the noise of the agents' trajectories that are complete."""
        self.scenario, self.agent_ids = scenario, agent_ids
        self._model = model
        there = scenario.agents.row_of
        rows = [there[name] for name in agent_ids if name in there]
        task = TrajectoryTask.of(
            scenario,
            np.array(rows, int),
            model.decoder.basis,
            config=model.config,
        ).to(model.decoder.get_buffer("mean_m").device)
        self._task = task
        scene = task.scene
        is_given = torch.from_numpy(task.is_given)[None].to(scene.has_future.device)
        self._known = KnownNoise(
            noise=inverted_noise(model, scene, task.context(model), is_given),
            exists=scene.has_future & ~is_given,
        )
        self._samples: dict[TrajectoryOptions, torch.Tensor] = {}

    def continued(
        self, task: TrajectoryTask, options: TrajectoryOptions
    ) -> Continuation:
        """Noise and correction for the agents of another task."""
        reference = self._sample(options)
        exists = self._known.exists
        gap = torch.where(exists[..., None], self._task.scene.future - reference, 0.0)
        ids, agents = self._task.features.agent_row, self._task.scenario.agents
        place = {agents.ids[row]: index for index, row in enumerate(ids)}
        names = task.scenario.agents.ids
        found = [place.get(names[row], -1) for row in task.features.agent_row]
        index = torch.tensor(found, device=exists.device)
        is_same = (index >= 0) & torch.from_numpy(task.is_sampled).to(index.device)
        return Continuation(
            known=KnownNoise(
                noise=self._known.noise[:, index],
                exists=exists[:, index] & is_same,
            ),
            reference=reference[:, index],
            correction=torch.where(is_same[:, None], gap[:, index], 0.0),
        )

    def _sample(self, options: TrajectoryOptions) -> torch.Tensor:
        """The sample from the noise in the scenario itself, without guidance terms.

        Terms are what an edit may change, and a guided sample obeys those in force.
        """
        options = replace(options, num_tries=1, terms=(), samples_unguided=False)
        sample = self._samples.get(options)
        if sample is None:
            run = TrajectorySampling(
                model=self._model, task=self._task, options=options
            )
            sample = sampled_from(run, self._known)
            if len(self._samples) >= _MOST_SAMPLES:
                self._samples.clear()
            self._samples[options] = sample
        return sample
