"""Samples signal plans of traffic lights: fixed-time or actuated, of various cycles."""

import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Final

import numpy as np

from pd_editor.base.errors import SynthesisError

LEAST_GREEN_S: Final = 7.0
ACTUATED_SHARE: Final = 0.5
"""Share of networks with actuated lights, whose green ends without arriving vehicles."""

PROGRAM_ID: Final = "sampled"


def sample_signal_plans(
    net_file: Path, green_share: tuple[float, float], random: np.random.Generator
) -> ElementTree.Element:
    """Sample an additional file for SUMO with a new program for each traffic light.

    ``green_share`` is the range of the factor of netconvert's green times.

    Raises:
        SynthesisError: the file is missing or no SUMO network.
    """
    try:
        lights = list(ElementTree.parse(net_file).getroot().iter("tlLogic"))
    except (OSError, ElementTree.ParseError) as error:
        raise SynthesisError(
            f"{net_file} is not a readable SUMO network ({error})."
        ) from error
    is_actuated = bool(random.random() < ACTUATED_SHARE)
    share = random.uniform(*green_share)
    root = ElementTree.Element("additional")
    for light in lights:
        root.append(_plan(light, share, is_actuated, random))
    return root


def _plan(
    light: ElementTree.Element,
    share: float,
    is_actuated: bool,
    random: np.random.Generator,
) -> ElementTree.Element:
    plan = ElementTree.Element(
        "tlLogic",
        {
            "id": light.attrib["id"],
            "type": "actuated" if is_actuated else "static",
            "programID": PROGRAM_ID,
            "offset": f"{random.uniform(0.0, 60.0):.0f}",
        },
    )
    for phase in light.iter("phase"):
        green_s = float(phase.attrib["duration"])
        changed = {"state": phase.attrib["state"]}
        if "y" not in phase.attrib["state"] and green_s > LEAST_GREEN_S:
            green_s = max(share * green_s, LEAST_GREEN_S)
            if is_actuated:
                changed |= {"minDur": f"{LEAST_GREEN_S}", "maxDur": f"{1.5 * green_s}"}
        changed["duration"] = f"{green_s:.1f}"
        ElementTree.SubElement(plan, "phase", changed)
    return plan
