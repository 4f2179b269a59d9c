"""Compiled code is never stale, and is shared by all copies of the same sources."""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from fork_server import ForkServer

import panoptic_ros
from panoptic_ros.kernels import cache, damaged_files, remove_damaged

ROOT = Path(panoptic_ros.__file__).parent
SERVER: list[ForkServer] = []
SAMPLE = {
    "__init__.py": "",
    "numbers.py": "FACTOR = 2.0\n",
    "callee.py": (
        "from panoptic_ros.kernels import njit\n"
        "from panoptic_ros.sample.numbers import (\n    FACTOR,\n)\n"
        "@njit(cache=True)\ndef scaled(x):\n    return FACTOR * x\n"
    ),
    "kernel.py": (
        "from panoptic_ros.kernels import njit\n"
        "from panoptic_ros.sample.callee import scaled\n"
        "@njit(cache=True)\ndef shifted(x):\n    return scaled(x) + 1.0\n"
        "@njit(cache=True)\ndef height(pair):\n    return pair.height\n"
    ),
    "pair.py": (
        "from typing import NamedTuple\nclass Pair(NamedTuple):\n    height: float\n    width: float\n"
    ),
    "other.py": "TEXT = ''\n",
}
PROGRAM = """
from panoptic_ros.kernels import on_compilation
from panoptic_ros.sample.kernel import height, shifted
from panoptic_ros.sample.pair import Pair
compiled = []
with on_compilation(compiled.append):
    print(shifted(3.0), height(Pair(height=1.0, width=2.0)))
print(*[name.rpartition(".")[2] for name in compiled if name.startswith("panoptic_ros")])
"""


@pytest.fixture
def copy(tmp_path):
    """Makes a package with the cache and a few kernels in a folder of this name."""

    return lambda name: sample_in(tmp_path / name)


def sample_in(folder: Path) -> Path:
    """Package in a folder that is made."""
    package = folder / "panoptic_ros"
    shutil.copytree(ROOT / "kernels", package / "kernels", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "__init__.py", package)
    (package / "sample").mkdir()
    for file, text in SAMPLE.items():
        (package / "sample" / file).write_text(text)
    return package


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """A folder with the package `a` and what it has compiled."""
    folder = tmp_path_factory.mktemp("compiled")
    package = sample_in(folder / "a")
    assert run(package) == ("7.0 1.0", "shifted scaled height")
    return folder


@pytest.fixture
def used(compiled, tmp_path):
    """The package `a` beside its compiled code, both to be changed by a test."""
    shutil.copytree(compiled, tmp_path, dirs_exist_ok=True)  # with the times of files
    return tmp_path / "a" / "panoptic_ros"


@pytest.fixture(scope="module", autouse=True)
def server():
    """A process with numba and its compiler, of which programs are forked."""
    with ForkServer("kernel_programs") as server:
        SERVER.append(server)
        yield
        SERVER.clear()


def run(package: Path, program: str = PROGRAM, apart: bool = False) -> tuple[str, str]:
    """What a program prints with a package: its result, and which kernels it compiled.

    It runs in a process that is forked, or apart in one that begins from nothing.
    """
    variables = {"NUMBA_CACHE_DIR": str(package.parent.parent / "kept")}
    if not apart:
        printed = package.parent.parent / "printed"
        printed.touch()
        process = SERVER[0].start(program, package.parent, output=printed, variables=variables)
        assert process.wait() == 0, printed.read_text()
        text = printed.read_text()
        printed.unlink()
    else:
        # Python's own files go by the time of a source, which a test keeps
        more = {"PYTHONPATH": str(package.parent), "PYTHONDONTWRITEBYTECODE": "1"}
        done = subprocess.run(
            [sys.executable, "-c", program],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, **variables, **more},
            cwd=package.parent,
        )
        text = done.stdout
    result, compiled = text.splitlines()
    return result, compiled


def test_a_second_run_compiles_nothing(used):
    assert run(used) == ("7.0 1.0", "")


@pytest.mark.parametrize(
    ("file", "old", "new", "result"),
    [
        ("numbers.py", "2.0", "5.0", "16.0 1.0"),  # a constant two files away
        ("callee.py", "FACTOR * x", "x", "4.0 1.0"),
        ("pair.py", "    height: float\n    width", "    width: float\n    height", "7.0 1.0"),
    ],
)
def test_an_edit_in_another_file_is_compiled(used, file, old, new, result):
    source = used / "sample" / file
    before = source.stat()
    source.write_text(source.read_text().replace(old, new))
    os.utime(source, ns=(before.st_atime_ns, before.st_mtime_ns))  # as some tools leave it
    assert run(used)[0] == result


def test_copies_of_the_same_sources_share_what_is_compiled(used, copy):
    assert run(copy("b")) == ("7.0 1.0", "")


def test_what_a_kernel_cannot_reach_compiles_nothing(used):
    (used / "sample" / "other.py").write_text("TEXT = 'edited'\n")
    assert run(used) == ("7.0 1.0", "")


def test_copies_of_the_whole_package_share_what_is_compiled(tmp_path):
    program = (
        "import numpy as np\nfrom panoptic_ros.kernels import on_compilation\n"
        "from panoptic_ros.offsets.trajectories import factor\n"
        "compiled, matrix = [], np.ones((3, 1))\n"
        "with on_compilation(compiled.append):\n    print(factor(matrix))\n"
        "print(*{name.rpartition('.')[2] for name in compiled if 'panoptic_ros.' in name})\n"
    )
    first, second = (tmp_path / name / "panoptic_ros" for name in "ab")
    for package in (first, second):
        shutil.copytree(ROOT, package, ignore=shutil.ignore_patterns("__pycache__"))
    assert run(first, program, apart=True) == ("True", "factor")
    assert run(second, program, apart=True) == ("True", "")


def test_nothing_is_kept_of_sources_that_were_edited_meanwhile(copy):
    package = copy("a")
    late = "import pathlib, time, panoptic_ros.kernels.sources as s\n"
    late += "time.sleep(0.05); pathlib.Path('panoptic_ros/sample/numbers.py').touch(); time.sleep(0.05)\n"
    assert run(package, late + PROGRAM)[1] == "shifted scaled height"
    assert run(package)[1] == "shifted scaled height"


def test_the_folder_follows_the_user(monkeypatch, tmp_path):
    def found(**variables):
        monkeypatch.setattr(os, "environ", {name: str(value) for name, value in variables.items()})
        cache.cache_folder.cache_clear()
        return cache.cache_folder()

    monkeypatch.setattr(cache.SETTINGS, "CACHE_DIR", "")
    monkeypatch.setattr(cache.tempfile, "gettempdir", lambda: str(tmp_path))
    blocked = tmp_path / "file"
    blocked.write_text("")
    own = tmp_path / f"panoptic_ros-kernels-{os.getuid()}"
    assert found(HOME=tmp_path) == tmp_path / ".cache/panoptic_ros/kernels"
    assert found(HOME=tmp_path, XDG_CACHE_HOME=tmp_path / "x") == tmp_path / "x/panoptic_ros/kernels"
    assert found(HOME=tmp_path, XDG_CACHE_HOME="relative") == tmp_path / ".cache/panoptic_ros/kernels"
    assert found(HOME=blocked) == own
    assert found() == own and own.stat().st_mode & 0o077 == 0
    other = os.getuid() + 1
    monkeypatch.setattr(os, "getuid", lambda: other)
    own.rename(tmp_path / f"panoptic_ros-kernels-{other}")
    with pytest.raises(PermissionError, match="NUMBA_CACHE_DIR"):
        found()
    monkeypatch.setattr(cache.SETTINGS, "CACHE_DIR", str(tmp_path / "mine"))
    assert found() == tmp_path / "mine/panoptic_ros"
    cache.cache_folder.cache_clear()


def test_old_versions_are_removed_and_the_last_used_kept(tmp_path):
    now = time.time()
    for age_days in range(8):
        folder = tmp_path / f"voting.kernels-{age_days}"
        folder.mkdir()
        os.utime(folder, (now - age_days * 86_500, now - age_days * 86_500))
    (tmp_path / "voting.kernels.more-0").mkdir()
    os.utime(tmp_path / "voting.kernels.more-0", (0, 0))
    cache.remove_old(tmp_path / "voting.kernels-0")
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        *(f"voting.kernels-{age_days}" for age_days in range(cache.KEPT)),
        "voting.kernels.more-0",
    ]


def test_no_folder_of_today_is_removed(tmp_path):
    for number in range(2 * cache.KEPT):
        (tmp_path / f"a-{number}").mkdir()
    cache.remove_old(tmp_path / "a-0")
    assert len(list(tmp_path.iterdir())) == 2 * cache.KEPT


def test_kernels_whose_records_of_arguments_have_moved_are_compiled_anew(used):
    """The kernel's own sources are the same; the module that its argument comes from has another name."""
    (used / "sample" / "pair.py").rename(used / "sample" / "couple.py")
    assert run(used, PROGRAM.replace("sample.pair", "sample.couple")) == ("7.0 1.0", "height")
    assert run(used, PROGRAM.replace("sample.pair", "sample.couple")) == ("7.0 1.0", "")


def test_what_is_compiled_already_is_used_without_the_compiler(copy):
    """Nothing of numba's that only compiling needs is loaded for it; what is new is compiled all the same."""
    package = copy("a")
    loaded = PROGRAM.replace("from panoptic_ros.kernels", "import sys\nfrom panoptic_ros.kernels", 1)
    loaded = loaded.replace("print(*[", "print('numba.np.arraymath' in sys.modules, *[")
    assert run(package, loaded, apart=True) == ("7.0 1.0", "True shifted scaled height")
    assert run(package, loaded, apart=True) == ("7.0 1.0", "False")
    new = loaded.replace("shifted(3.0)", "shifted(3.0), shifted(3)")
    assert run(package, new, apart=True) == ("7.0 7.0 1.0", "True shifted scaled")


def cut(data: bytes) -> bytes:
    return data[:50]


def emptied(data: bytes) -> bytes:
    return b""


def other_bytes(data: bytes) -> bytes:
    return bytes(k * 37 % 256 for k in range(len(data)))


def one_bit(data: bytes) -> bytes:
    return data[:-100] + bytes([data[-100] ^ 4]) + data[-99:]


@pytest.mark.parametrize("damage", [cut, emptied, other_bytes, one_bit])
def test_damaged_files_are_compiled_again(used, tmp_path, damage):
    """Damage the code of one kernel and the index of the other."""
    (folder,) = (tmp_path / "kept" / "panoptic_ros").glob("sample.kernel-*")
    indices, codes = sorted(folder.glob("*.nbi")), sorted(folder.glob("*.nbc"))
    files = [codes[0], indices[-1]]
    assert len(indices) == 2 and codes[0].name.split("-")[0] == indices[0].name.split("-")[0]
    for path in files:
        path.write_bytes(damage(path.read_bytes()))
    assert set(damaged_files(tmp_path / "kept" / "panoptic_ros")) == set(files)
    result, compiled = run(used)
    assert result == "7.0 1.0" and {"shifted", "height"} <= set(compiled.split())
    assert run(used) == ("7.0 1.0", "")
    assert not damaged_files(tmp_path / "kept" / "panoptic_ros")


def test_damaged_files_can_be_removed(used, tmp_path):
    path = next(path for path in (tmp_path / "kept").rglob("*.nbc") if path.is_file())
    path.write_bytes(cut(path.read_bytes()))
    assert remove_damaged(tmp_path / "kept" / "panoptic_ros") == 1
    assert remove_damaged(tmp_path / "kept" / "panoptic_ros") == 0
    assert run(used)[0] == "7.0 1.0"
