"""`panoptic ltc encode` and `panoptic ltc decode`."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from panoptic_ros.cli.main import main
from panoptic_ros.io.wav import write_wav


def test_encode_then_decode(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wav, out = str(tmp_path / "a.wav"), tmp_path / "a.json"
    assert (
        main(
            [
                "ltc",
                "encode",
                "--start",
                "01:02:03:04",
                "--rate",
                "25",
                "--seconds",
                "2",
                "--sample-rate",
                "48000",
                "--user-bits",
                "12abcdef",
                wav,
            ]
        )
        == 0
    )
    assert main(["ltc", "decode", wav, "--json", str(out)]) == 0
    document = json.loads(out.read_text())
    assert {key: document[key] for key in ("format", "rate_hz", "frame_rate")} == {
        "format": "panoptic-ltc-1",
        "rate_hz": 48000,
        "frame_rate": 25.0,
    }
    frames = document["frames"]
    assert len(frames) == 50
    assert set(frames[0]) == {"timecode", "start_sample", "std_samples", "reverse", "user_bits"}
    assert frames[0]["timecode"] == "01:02:03:04" and frames[49]["timecode"] == "01:02:05:03"
    np.testing.assert_allclose([f["start_sample"] for f in frames], 1920.0 * np.arange(50), atol=0.1)
    assert frames[7]["user_bits"] == "12abcdef" and frames[7]["reverse"] is False
    capsys.readouterr()
    assert main(["ltc", "decode", wav]) == 0
    assert "50 words at 25 Hz" in capsys.readouterr().out


def test_drop_frame_backwards_to_standard_output(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wav = str(tmp_path / "a.wav")
    assert (
        main(
            ["ltc", "encode", "--start", "00:01:00;10", "--rate", "29.97", "--seconds", "1", "--reverse", wav]
        )
        == 0
    )
    capsys.readouterr()
    assert main(["ltc", "decode", wav, "--json", "-"]) == 0
    document = json.loads(capsys.readouterr().out)
    labels = [frame["timecode"] for frame in document["frames"]]
    assert labels[:10] == [f"00:01:00;{f:02d}" for f in range(10, 1, -1)] + ["00:00:59;29"]
    assert document["frame_rate"] == pytest.approx(30000 / 1001)
    assert all(frame["reverse"] for frame in document["frames"])


def test_a_file_without_timecode(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_wav(tmp_path / "a.wav", 48000, np.random.default_rng(0).normal(0, 0.1, 48000))
    assert main(["ltc", "decode", str(tmp_path / "a.wav"), "--json", str(tmp_path / "a.json")]) == 0
    assert json.loads((tmp_path / "a.json").read_text())["frames"] == []
    assert "no timecode found" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["decode", "missing.wav"], "No such file"),
        (["encode", "--start", "1:2:3:4", "x.wav"], "is not a timecode; write HH:MM:SS:FF"),
        (["encode", "--start", "00:00:00:25", "x.wav"], "no such timecode"),
        (["encode", "--start", "00:01:00;00", "--rate", "29.97", "x.wav"], "no such timecode"),
        (["encode", "--start", "00:00:00;00", "--rate", "25", "x.wav"], "drop-frame timecode exists"),
        (["encode", "--user-bits", "xyz", "x.wav"], "are not 8 hex digits"),
        (["encode", "--seconds", "-1", "x.wav"], "cannot make -1.0 s"),
    ],
)
def test_mistakes_of_the_user(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    says: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["ltc", *arguments]) == 2
    error = capsys.readouterr().err
    assert says in error and error.count("\n") == 1
    assert not list(tmp_path.iterdir())
