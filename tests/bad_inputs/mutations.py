"""Ways to spoil bytes, JSON values and texts, at random."""

import copy
import json
from typing import Any

import numpy as np

ODD_TEXTS = (
    "",
    "a\nb",
    "nul\0",
    "half \ud800",
    "x" * 300,
    "../../etc/passwd",
    "\u202eturned",
    "%s%n{0}",
    "-1",
    "💥" * 90,
)
ODD_VALUES: tuple[Any, ...] = (
    None,
    True,
    -1,
    0,
    1.5,
    1e6,
    -1e300,
    10**21,
    float("nan"),
    float("inf"),
    [],
    {},
    [[1]],
    {"a": {"b": 1}},
    *ODD_TEXTS,
)


def spoiled_bytes(data: bytes, random: np.random.Generator) -> bytes:
    """The bytes cut off, with bits flipped, with a part repeated, or others."""
    kind = random.integers(6)
    at = int(random.integers(max(len(data), 1)))
    if kind == 0:
        return data[:at]
    if kind == 1:
        changed = bytearray(data)
        for place in random.integers(max(len(data), 1), size=random.integers(1, 20)):
            if changed:
                changed[place] ^= 1 << int(random.integers(8))
        return bytes(changed)
    if kind == 2:
        return data[:at] + data[at // 2 :]
    if kind == 3:
        return data[:at] + random.bytes(64) + data[at + 64 :]
    if kind == 4:
        return random.bytes(int(random.integers(2000)))
    return data[:at] + b"\0" * 4096 + data[at:]


def spoiled_json(value: Any, random: np.random.Generator) -> Any:
    """A copy of a JSON value with one to three places changed."""
    changed = copy.deepcopy(value)
    for _ in range(random.integers(1, 4)):
        holder, key = _place(changed, random)
        if holder is None:
            break
        kind = random.integers(6)
        if kind == 0:
            del holder[key]
        elif kind == 1:
            holder[key] = [holder[key]]
        elif kind == 2 and isinstance(holder, dict):
            holder[str(random.choice(ODD_TEXTS))] = copy.deepcopy(holder[key])
        elif kind == 3 and isinstance(holder[key], (int, float)):
            holder[key] = holder[key] * float(random.choice([-1, 0, 1e3, 1e9, 1e30]))
        else:
            holder[key] = copy.deepcopy(ODD_VALUES[random.integers(len(ODD_VALUES))])
    return changed


def json_text(value: Any, random: np.random.Generator) -> bytes:
    """A JSON value as bytes, now and then spoiled as text too."""
    data = json.dumps(value).encode()
    return spoiled_bytes(data, random) if random.random() < 0.15 else data


def _place(value: Any, random: np.random.Generator) -> tuple[Any, Any]:
    """A container somewhere in a value, and one of its keys."""
    holder, key = None, None
    while isinstance(value, (dict, list)) and len(value):
        holder = value
        if isinstance(value, dict):
            key = list(value)[random.integers(len(value))]
        else:
            key = int(random.integers(len(value)))
        value = value[key]
        if random.random() < 0.2:
            break
    return holder, key
