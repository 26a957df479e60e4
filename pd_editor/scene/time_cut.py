"""Cuts a recording to the part of the map and the time that are asked for."""

import hashlib
import math
from dataclasses import replace
from typing import Final

import numpy as np

from pd_editor.base.errors import InputError
from pd_editor.scene.base_reference import SceneCut
from pd_editor.scene.map_window import within_window
from pd_editor.scene.scenario import Provenance, Scenario
from pd_editor.scene.time_axis import TimeAxis

FUTURE_S: Final = TimeAxis().future_s
"""Future that the shipped models sample, and that methods are compared on."""
COMPARED: Final = SceneCut(until_s=FUTURE_S)
"""What methods are compared on: of the scene as it is, what models sample."""
_MORE: Final = 1e-6
"""Steps by which times may be off by rounding."""


def is_long(scenario: Scenario) -> bool:
    """Whether the future is longer than ``FUTURE_S`` by more than rounding."""
    axis = scenario.time_axis
    return axis.future_s > FUTURE_S + 0.05


def cut_scenario(scenario: Scenario, cut: SceneCut) -> Scenario:
    """Keep a part of the map; make another step current, leave out what is later.

    Agents that are only there later are left out.

    Raises:
        InputError: the recording is shorter, a number is not positive, or the part of
            the map is empty.
    """
    if cut.window is not None:
        scenario = within_window(scenario, cut.window)
        # The part of the map alone, unless times are cut below.
        scenario = scenario.with_origin(cut=SceneCut(window=cut.window))
    axis = scenario.time_axis
    now, last = steps_of_cut(axis, cut)
    if (now, last) == (axis.current_step, axis.num_steps - 1):
        return scenario
    steps = slice(last + 1)
    agents = scenario.agents.cut_to(steps)
    is_valid = agents.is_valid
    agents = replace(agents, observed=is_valid & (np.arange(last + 1) <= now)).taken(
        is_valid.any(axis=1)
    )
    span = axis.end_timestamp_ns - axis.start_timestamp_ns
    share = last / max(axis.num_steps - 1, 1)
    end = axis.start_timestamp_ns + type(span)(span * share)
    return replace(
        scenario,
        agents=agents,
        signals=tuple(
            replace(one, states=one.states[steps]) for one in scenario.signals
        ),
        time_axis=replace(
            axis, num_steps=last + 1, current_step=now, end_timestamp_ns=end
        ),
        provenance=origin_of_cut(scenario.provenance, cut, now, last),
    )


def steps_of_cut(axis: TimeAxis, cut: SceneCut) -> tuple[int, int]:
    """Current and last step that a cut leaves of a recording.

    Raises:
        InputError: the recording is shorter, or a number is not positive.
    """
    for name, value in (("current", cut.current_s), ("until", cut.until_s)):
        if value is not None and not 0 < value < math.inf:
            raise InputError(f"--{name} is {value:g}; expected seconds above 0.")
    now, last = axis.current_step, axis.num_steps - 1
    if cut.current_s is not None:
        now = max(math.ceil(cut.current_s / axis.step_s - _MORE), 1) - 1
    if cut.until_s is not None:
        last = now + math.floor(cut.until_s / axis.step_s + _MORE)
    if now > axis.num_steps - 1 or (cut.until_s is not None and now >= last):
        raise InputError(
            f"The recording has {axis.num_steps} steps of {axis.step_s:g} s; expected"
            " a current step (--current) and a later one (--until) among them."
        )
    return now, min(last, axis.num_steps - 1)


def origin_of_cut(origin: Provenance, cut: SceneCut, *numbers: float) -> Provenance:
    """Where a part of a recording is from; the numbers tell it from other parts."""
    # Edits of the cut recording do not fit the whole one.
    text = " ".join(map(str, (origin.content_sha256, *numbers)))
    digest = hashlib.sha256(text.encode()).hexdigest()
    return replace(origin, cut=cut, content_sha256=digest)
