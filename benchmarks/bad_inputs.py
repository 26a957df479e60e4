"""How 2,000 bad inputs of eight kinds are taken, each in a process of its own.

Each must be refused in one sentence, or be accepted and then open, be judged and be
written without trouble: no traceback, no hang (20 s of processor time), at most 1 GiB in all. Options: ``--num``,
``--seed`` and ``--kinds``, and ``--only KIND NUMBER`` for one input, whose words are shown.
"""

import argparse
import shutil
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import torch

from benchmarks.figures import load_in_words
from tests.bad_inputs.inputs import KINDS, bad_input
from tests.bad_inputs.isolation import VERDICTS, Ending, ending_of

SHARES = {"models": 0.6, "messages": 0.2, "journals": 0.8}
"""Inputs of a kind against those of the others; a set of messages holds twenty."""
TROUBLE = ("unclear", "crash", "hang", "memory")


def taken(kind: str, number: int, seed: int) -> Ending:
    """How an input is taken."""
    folder = Path(tempfile.mkdtemp(prefix="bad-input-"))
    try:
        return ending_of(bad_input(kind, number, seed, folder), folder)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def main() -> int:
    """Print the table; the exit code is 1 if an input was taken badly."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--num", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=list(KINDS))
    parser.add_argument("--only", nargs=2, metavar=("KIND", "NUMBER"))
    options = parser.parse_args()
    # A fork must not need threads that it does not have.
    torch.set_num_threads(1)
    if options.only:
        print(taken(options.only[0], int(options.only[1]), options.seed))
        return 0
    shares = {kind: SHARES.get(kind, 1.0) for kind in options.kinds}
    total = sum(shares.values())
    print(f"| inputs | number | {' | '.join(VERDICTS)} | longest | most memory |")
    print(f"|---{'|---' * (len(VERDICTS) + 3)}|")
    troubles: list[str] = []
    num_all = 0
    for kind, share in shares.items():
        began = time.monotonic()
        num = max(round(options.num * share / total), 1)
        endings = [taken(kind, number, options.seed) for number in range(num)]
        num_all += num
        count = Counter(ending.verdict for ending in endings)
        longest = max(ending.elapsed_s for ending in endings)
        most = max(ending.peak_bytes for ending in endings)
        print(
            f"| {kind} | {num} | {' | '.join(str(count[one]) for one in VERDICTS)} | "
            f"{longest:.1f} s | {most >> 20} MiB |",
            flush=True,
        )
        troubles += [
            f"--only {kind} {number} --seed {options.seed}: {ending.verdict}: "
            f"{ending.said.strip()[-300:]!r}"
            for number, ending in enumerate(endings)
            if ending.verdict in TROUBLE
        ]
        print(f"{kind}: {time.monotonic() - began:.0f} s", file=sys.stderr)
    print(f"{num_all} inputs, {len(troubles)} in trouble; {load_in_words()}")
    print("\n".join(troubles))
    return int(bool(troubles))


if __name__ == "__main__":
    sys.exit(main())
