"""Converts the argument parser's error box to one sentence."""

import re
from collections.abc import Sequence
from typing import Final

_EDGES: Final = "╭╮╰╯│─+|- "
"""Characters of box borders; the second half where the output is not in UTF-8."""
_REWORDED: Final = (
    (r"invalid literal for int\(\) with base 10: (.*)", r"\1 is not a whole number"),
    (r"could not convert string to float: (.*)", r"\1 is not a number"),
    (r"no type matching .* could be instantiated from \[(.*)\]", r"\1 does not fit"),
    (r"Exceeds the limit .*", "the number has too many digits"),
    (r"Error parsing (\S+?): ", r"\1: "),
    (
        r"invalid choice (.*) for argument '(\S+)'\. Expected",
        r"\2: \1 is no choice; expected",
    ),
    (r"(?<=one of )\('(.*)',?\)", r"\1"),
    (r"(?<=\w)', '(?=\w)", ", "),
    (r"Missing value for argument '(\S+)'\. Expected.*", r"\1 lacks its value"),
    (r"Unrecognized options: ", "unknown arguments: "),
    (r"Expected one of \{(.*)\}", r"a command is missing; choose among \1"),
)


def usage_error(
    box: str, arguments: Sequence[str], commands: Sequence[str], *group: str
) -> str:
    """Convert the parser's output to one sentence.

    Args:
        box: Output of the parser.
        arguments: The command line.
        commands: All subcommands.
        group: The command that they are actions of.
    """
    body: list[str] = []
    for line in box.splitlines()[1:]:
        inside = re.sub(r"^[│|]|[│|]$", "", line)
        if inside.strip(_EDGES):
            body.append(inside)
        elif body:
            break
    missing = [line.split()[0] for line in body[1:] if re.match(r" {4,6}\S", line)]
    if body and body[0].strip().startswith("Missing from") and missing:
        sentence = f"missing {', '.join(missing)}"
    else:
        sentence = " ".join(" ".join(body).split())
        for pattern, words in _REWORDED:
            sentence = re.sub(pattern, words, sentence)
    sentence = sentence.rstrip(". ") or "the arguments cannot be read"
    if arguments and arguments[0] not in commands and not arguments[0].startswith("-"):
        sentence = f"there is no command {arguments[0]!r}; choose among "
        sentence += ", ".join(commands)
    known = [one for one in arguments[:1] if one in commands]
    help_of = " ".join(["pd-editor", *group, *known, "--help"])
    return f"{sentence[0].upper()}{sentence[1:]}; see {help_of}."
