"""Sources that a module imports directly or indirectly, and hashes of their contents."""

from __future__ import annotations

import re
import time
from functools import cache
from hashlib import sha256
from pathlib import Path

PACKAGE = "panoptic_ros"
ROOT = Path(__file__).resolve().parent.parent
BEGAN_S = time.time()  # process start; sources edited later may differ from the imported ones
_NAMES = rb"(?:\(([^)]*)\)|([^\n]*))"
_FROM = re.compile(rb"^[ \t]*from[ \t]+(" + PACKAGE.encode() + rb"[\w.]*)[ \t]+import[ \t]+" + _NAMES, re.M)
_IMPORT = re.compile(rb"^[ \t]*import[ \t]+([^\n#]*)", re.M)


@cache
def closure(module: str) -> tuple[Path, ...]:
    """Return all sources of the package that a module's compiled code may depend on, its own first.

    They are found by reading the import statements, including those in functions. A name in a comment may add
    a file. This costs a compilation at worst and never gives a wrong result.
    """
    found: dict[Path, None] = {}
    waiting = [module]
    while waiting:
        path = _path(waiting.pop())
        if path is not None and path not in found:
            found[path] = None
            waiting += sorted(_imports(path))
    return tuple(found)


def closure_hash(module: str) -> str:
    """Return a hash of the paths (relative to the package) and contents of `closure`."""
    return _hash(closure(module))


def all_sources_hash() -> str:
    """Return a hash of all sources of the package.

    The set of called kernels and their argument types may depend on any source.
    """
    return _hash(tuple(sorted(ROOT.rglob("*.py"))))


@cache
def edited_meanwhile(module: str) -> bool:
    """Return whether a source of `closure` was edited since this process started.

    The process may then have imported the older version.
    """
    return any(BEGAN_S < path.stat().st_mtime < time.time() for path in closure(module))


def _hash(paths: tuple[Path, ...]) -> str:
    state = sha256()
    for path in sorted(paths):
        state.update(f"{path.relative_to(ROOT).as_posix()} {_content_hash(path)}\n".encode())
    return state.hexdigest()


@cache
def _content_hash(path: Path) -> str:
    return sha256(path.read_bytes()).hexdigest()


@cache
def _imports(path: Path) -> frozenset[str]:
    """Return names of modules that a source imports, and of their parent packages; some may not exist."""
    source = path.read_bytes()
    found = set()
    for base, many, few in _FROM.findall(source):
        found |= {base, *(base + b"." + name for name in re.findall(rb"\w+", many or few))}
    for line in _IMPORT.findall(source):
        found |= set(re.findall(rb"\b" + PACKAGE.encode() + rb"[\w.]*", line))
    names = [name.decode() for name in found]
    return frozenset(".".join(name.split(".")[:n]) for name in names for n in range(1, name.count(".") + 2))


@cache
def _path(module: str) -> Path | None:
    """Return the source of a module of the package; None if no module has this name."""
    place = ROOT.joinpath(*module.split(".")[1:])
    for path in (place / "__init__.py", place.with_suffix(".py")):
        if path.is_file():
            return path
    return None
