"""What pip and colcon make of the checkout."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

COLCON = shutil.which("colcon", path=str(Path(sys.executable).parent)) or shutil.which("colcon")
needs_colcon = pytest.mark.skipif(COLCON is None, reason="colcon is not installed (pip install colcon-ros)")
needs_list = pytest.mark.skipif(
    importlib.util.find_spec("colcon_package_information") is None,
    reason="colcon list is not installed (pip install colcon-package-information)",
)


def _run(*command: str, cwd: Path, home: Path) -> str:
    environment = {**os.environ, "HOME": str(home), "COLCON_LOG_PATH": str(home / "log")}
    done = subprocess.run(
        command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def _names(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def test_the_wheel_holds_modules_data_and_one_command(checkout: Path, tmp_path: Path) -> None:
    _run(
        sys.executable,
        "-m",
        "pip",
        "wheel",
        "--no-deps",
        "--no-build-isolation",
        "--no-index",
        "--wheel-dir",
        str(tmp_path / "wheels"),
        str(checkout),
        cwd=tmp_path,
        home=tmp_path,
    )
    (wheel,) = (tmp_path / "wheels").glob("panoptic_ros-*.whl")
    assert wheel.name.endswith("-py3-none-any.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        scripts = next(name for name in names if name.endswith("entry_points.txt"))
        assert archive.read(scripts).decode().split() == [
            "[console_scripts]",
            "panoptic",
            "=",
            "panoptic_ros.cli.main:program",
        ]
    modules = {name for name in _names(checkout) if name.startswith("panoptic_ros/") and name.endswith(".py")}
    assert modules <= names
    page = {name for name in _names(checkout) if name.startswith("panoptic_ros/view/page/static/")}
    assert "panoptic_ros/view/page/static/vendor/three.js" in page and page <= names
    share = next(name for name in names if name.endswith("/share/panoptic_ros/package.xml"))
    installed = {name.removeprefix(share.removesuffix("package.xml")) for name in names}
    wanted = {name for name in _names(checkout) if name.startswith(("config/", "launch/"))}
    assert "config/fastdds.xml" in wanted and "launch/panoptic.launch.py" in wanted
    assert wanted <= installed
    assert any(name.endswith("share/ament_index/resource_index/packages/panoptic_ros") for name in names)


@needs_colcon
@needs_list
def test_colcon_sees_both_packages_with_their_types(checkout: Path, tmp_path: Path) -> None:
    told = _run(str(COLCON), "list", "--base-paths", ".", "msg_defs", cwd=checkout, home=tmp_path)
    rows = sorted(tuple(line.split("\t")) for line in told.splitlines())
    assert rows == [
        ("panoptic_msgs", "msg_defs", "(ros.ament_cmake)"),
        ("panoptic_ros", ".", "(ros.ament_python)"),
    ]


@needs_colcon
@pytest.mark.parametrize("option", [(), ("--symlink-install",)])
def test_colcon_builds_executables_where_ros_looks_for_them(
    checkout: Path, tmp_path: Path, option: tuple[str, ...]
) -> None:
    _run(
        str(COLCON),
        "build",
        *option,
        "--base-paths",
        ".",
        "--packages-select",
        "panoptic_ros",
        "--build-base",
        str(tmp_path / "build"),
        "--install-base",
        str(tmp_path / "install"),
        cwd=checkout,
        home=tmp_path,
    )
    prefix = tmp_path / "install" / "panoptic_ros"
    programs = {path.name for path in (prefix / "lib" / "panoptic_ros").iterdir()}
    assert {"panoptic", "camera", "rig", "detection", "sync", "voting", "refinement"} <= programs
    assert all(os.access(prefix / "lib" / "panoptic_ros" / name, os.X_OK) for name in programs)
    share = prefix / "share" / "panoptic_ros"
    assert (share / "package.xml").is_file()
    assert (share / "launch" / "panoptic.launch.py").is_file()
    assert (share / "config" / "skeletons" / "panoptic19.yaml").is_file()
    assert (prefix / "share" / "ament_index" / "resource_index" / "packages" / "panoptic_ros").is_file()
