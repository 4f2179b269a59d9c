"""Presets are parameters that belong together; what the user says beside them counts more."""

import argparse

import pytest
import yaml

from panoptic_ros.cli.main import main
from panoptic_ros.cli.run import add_arguments, source
from panoptic_ros.errors import ConfigError
from panoptic_ros.io.files import read_json
from panoptic_ros.io.skeletons import load_skeleton
from panoptic_ros.running.plans.parameters import read_parameters
from panoptic_ros.running.plans.presets import NO_PRESET, preset_names, read_preset


@pytest.mark.parametrize("name", preset_names())
def test_every_preset_can_be_read(name):
    preset = read_preset(name)
    assert preset.name == name and preset.parameters
    assert preset.skeleton == "" or load_skeleton(preset.skeleton)


def test_the_papers_first_stage():
    preset = read_preset("panoptic-studio")
    assert len(load_skeleton(preset.skeleton)) == 15
    voting = preset.parameters["voting"]
    assert voting["method"] == "exact" and voting["voxel"] == 0.04 and voting["threshold"] == 0.05
    assert preset.parameters["assembly"] == {"method": "dynamic_programming", "correspondence_px": 10.0}
    assert preset.parameters["tracking"]["method"] == "head"
    assert preset.parameters["refinement"] == {"method": "averaging"}


def test_a_file_counts_more_than_a_preset_and_a_setting_more_than_a_file(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text(yaml.safe_dump({"voting": {"threshold": 0.1, "min_views": 4}}))
    own = tmp_path / "preset.yml"
    own.write_text(yaml.safe_dump({"voting": {"threshold": 0.2, "min_views": 5, "voxel": 0.05}}))
    found = read_parameters(file, ["voting.min_views=6"], read_preset(str(own)).parameters)
    assert found == {"voting": {"threshold": 0.1, "min_views": 6, "voxel": 0.05}}
    assert read_preset(None) == read_preset("") == NO_PRESET


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("skeleton: newt", "newt"),
        ("voting: {size: 3}", "unknown parameter 'voting.size'"),
        ("[1, 2]", "must hold .stage: .parameter: value"),
        ("voting: 7", "must hold .stage: .parameter: value"),
    ],
)
def test_a_preset_that_says_something_else_is_refused(text, told, tmp_path):
    file = tmp_path / "preset.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=told):
        read_preset(str(file))


def test_solving_with_a_preset(tmp_path, capsys):
    scene, out = tmp_path / "scene", tmp_path / "skeletons.json.gz"
    assert main(["simulate", "three-views-2p", "--seed", "2", "--frames", "3", "--out", str(scene)]) == 0
    given = ["--rig", str(scene / "rig.json"), "--detections", str(scene / "detections.json.gz")]
    options = ["--set", "voting.volume=-2,-2,0,2,2,2", "--out", str(out)]
    assert main(["solve", *given, *options, "--preset", "panoptic-studio"]) == 0
    assert len(read_json(out)["joint_names"]) == 15
    assert main(["solve", *given, *options, "--preset", "panoptic-studio", "--skeleton", "auto"]) == 0
    assert len(read_json(out)["joint_names"]) == 19
    capsys.readouterr()
    assert main(["solve", *given, *options, "--preset", "kinoptic"]) == 2
    error = capsys.readouterr().err
    assert "there is no preset 'kinoptic'; there are panoptic-studio" in error and error.count("\n") == 1


def test_a_run_takes_a_preset_and_its_skeleton_where_the_recording_has_none(monkeypatch):
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    words = ["--demo", "--out", "out", "--preset", "panoptic-studio", "--set", "voting.voxel=0.05"]
    asked = []
    monkeypatch.setattr(source, "plan_demo", lambda name, options, **more: asked.append(options))
    source.make_plan(parser.parse_args(words))
    (options,) = asked
    assert (options.skeleton, options.chosen_skeleton) == ("", "panoptic15")
    assert options.parameters["voting"]["voxel"] == 0.05
    assert options.parameters["tracking"]["method"] == "head"
