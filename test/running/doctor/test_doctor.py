"""`panoptic doctor`: findings on a machine that is made to lack things."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import pytest

from panoptic_ros.cli import doctor
from panoptic_ros.cli.main import main
from panoptic_ros.io.takes import OpenTake
from panoptic_ros.running.doctor import checks as machine
from panoptic_ros.running.doctor import checks as network
from panoptic_ros.running.doctor import ros
from panoptic_ros.running.doctor.finding import Finding, fail, finish, ok, run_checks, start_python, warn

needs_wheels = pytest.mark.skipif(not ros._from_wheels(), reason="ROS is that of the system, not from wheels")


def test_one_line_per_check_and_a_sum() -> None:
    findings = {"disk": ok("much"), "model": warn("none", "fetch it"), "rclpy": fail("gone", "install it")}
    lines = doctor.as_lines(findings).splitlines()
    assert lines == [
        "OK    disk   much",
        "WARN  model  none; remedy: fetch it",
        "FAIL  rclpy  gone; remedy: install it",
        "1 OK, 1 WARN, 1 FAIL",
    ]


@pytest.mark.parametrize(("finding", "code"), [(ok("x"), 0), (warn("x", "y"), 0), (fail("x", "y"), 2)])
def test_exit_code_and_document(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], finding: Finding, code: int
) -> None:
    monkeypatch.setattr(doctor, "CHECKS", {"one": lambda: finding})
    assert main(["doctor", "--json"]) == code
    document = json.loads(capsys.readouterr().out)
    assert document["healthy"] is (code == 0)
    assert document["checks"] == [
        {"check": "one", "level": finding.level, "found": "x", "remedy": finding.remedy}
    ]


def test_what_cannot_be_imported_or_reached_is_a_finding() -> None:
    def lacks_module() -> Finding:
        raise ModuleNotFoundError("No module named 'cv2'")

    def lacks_disk() -> Finding:
        raise PermissionError(13, "Permission denied", "/somewhere")

    findings = run_checks({"a": lacks_module, "b": lacks_disk})
    assert [finding.level for finding in findings.values()] == ["FAIL", "FAIL"]
    assert "cv2" in findings["a"].found and "/somewhere" in findings["b"].found


def test_a_process_that_hangs_is_ended() -> None:
    outcome = finish(start_python("import time; time.sleep(60)"), timeout_s=0.5)
    assert not outcome.succeeded and "0.5 s" in outcome.last_error


def test_machine_checks_hold_here() -> None:
    for name in ("python", "packages", "onnxruntime", "video", "cache"):
        finding = machine.MACHINE_CHECKS[name]()
        assert finding.level == "OK", (name, finding)


def test_old_python_and_other_machines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine.platform, "machine", lambda: "aarch64")
    assert machine.check_python().level == "WARN"
    monkeypatch.setattr(machine, "SUPPORTED", ((3, 98), (3, 99)))
    assert machine.check_python().level == "FAIL"


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "PACKAGES", ("numpy", "no-such-package"))
    finding = machine.check_packages()
    assert finding.level == "FAIL" and finding.found == "missing: no-such-package"


def test_a_model_that_was_never_fetched(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PANOPTIC_CACHE", str(tmp_path))
    finding = machine.check_model()
    assert (finding.level, finding.remedy) == ("WARN", "panoptic models fetch")


def test_a_full_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    for limit, level in (("NO_SPACE", "FAIL"), ("LITTLE_SPACE", "WARN")):
        with monkeypatch.context() as patch:
            patch.setattr(machine, limit, 1e9)
            assert machine.check_disk().level == level


def test_a_cache_that_cannot_be_written(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("PANOPTIC_CACHE", str(tmp_path / "file"))
    finding = machine.check_cache()
    assert finding.level == "FAIL" and "PANOPTIC_CACHE" in finding.remedy


@needs_wheels
def test_the_guard_without_its_library_path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(ros.GUARD, "1")
    monkeypatch.setenv("LD_LIBRARY_PATH", "/usr/lib")
    finding = ros.check_environment()
    assert (finding.level, finding.remedy) == ("FAIL", f"unset {ros.GUARD}")


@needs_wheels
def test_another_ros_and_another_middleware(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("LD_LIBRARY_PATH", str(Path(sys.prefix) / "lib"))
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")
    assert ros.check_environment().level == "FAIL"
    (tmp_path / "librcl.so").touch()
    monkeypatch.setenv("LD_LIBRARY_PATH", f"{tmp_path}:{Path(sys.prefix) / 'lib'}")
    finding = ros.check_environment()
    assert finding.level == "WARN" and str(tmp_path) in finding.found


def test_definitions_that_differ_are_named(tmp_path: Path) -> None:
    one, two = {"A": "x", "B": "y", "C": "z"}, {"A": "x", "B": "other", "D": "w"}
    for folder, texts in (("one", one), ("two", two)):
        (tmp_path / folder).mkdir()
        for name, text in texts.items():
            (tmp_path / folder / f"{name}.msg").write_text(text)
    assert ros._differences(tmp_path / "one", tmp_path / "two") == ["B.msg", "C.msg", "D.msg"]


def test_log_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in ("HOME", "ROS_HOME", "ROS_LOG_DIR"):
        monkeypatch.delenv(name, raising=False)
    assert ros.check_log_folder().level == "FAIL"
    monkeypatch.setenv("HOME", str(tmp_path))
    assert ros.check_log_folder() == ok(f"{tmp_path}/.ros/log is writable")
    (tmp_path / "file").touch()
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "file"))
    assert ros.check_log_folder().level == "FAIL"


def test_shared_memory_and_leftovers(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(network, "SHARED_MEMORY", tmp_path)
    with (tmp_path / "fastrtps_0123").open("wb") as file:
        file.truncate(65 << 20)
    (tmp_path / "fastrtps_0123_el").touch()
    os.utime(tmp_path / "fastrtps_0123_el", (0, 0))
    assert network.check_leftovers().level == "WARN"
    monkeypatch.setattr(network, "LITTLE_SHARED_MEMORY", 1 << 40)
    finding = network.check_shared_memory()
    assert finding.level == "WARN" and "--shm-size" in finding.remedy
    monkeypatch.setattr(network, "SHARED_MEMORY", tmp_path / "none")
    assert network.check_shared_memory().level == "WARN"


@pytest.mark.parametrize(
    ("variable", "value"), [("ROS_DOMAIN_ID", "300"), ("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")]
)
def test_settings_that_keep_nodes_apart(monkeypatch: pytest.MonkeyPatch, variable: str, value: str) -> None:
    monkeypatch.setenv(variable, value)
    finding = network.check_graph()
    assert finding.level == "FAIL" and value in finding.found


@pytest.mark.ros
def test_ros_checks_hold_here(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_DOMAIN_ID", "86")
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path))
    for check in (ros.check_rclpy, ros.check_messages, network.check_graph):
        finding = check()
        assert finding.level == "OK", finding


def test_takes_that_were_not_closed_are_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.chdir(tmp_path)
    assert machine.check_takes().level == "OK"
    (tmp_path / "out" / "live").mkdir(parents=True)
    OpenTake(tmp_path / "out" / "live").leave()
    for elsewhere in ("state", "other"):  # listed by this user, and found below this folder alone
        monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / elsewhere))
        finding = machine.check_takes()
        assert finding.level == "WARN" and "panoptic bag repair" in finding.remedy
        assert finding.found.count("was not closed") == 1
