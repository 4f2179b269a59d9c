"""The generated parameter files are up to date."""

import pytest
import yaml

from panoptic_ros.cli.main import main
from panoptic_ros.graph.build import config_class, parse_setting
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.io.resources import share_folder
from panoptic_ros.params import describe, load
from panoptic_ros.running.generated_files import generated_files


@pytest.mark.parametrize("name", sorted(generated_files()))
def test_generated_file_is_up_to_date(name):
    assert (share_folder() / name).read_text() == generated_files()[name], "run: panoptic config write"


def test_a_lab_changes_few_parameters_and_is_told_when():
    """A new parameter is for experts: of the others there must not be so many that nobody reads them."""
    every = [(stage, item) for stage in NODES for item in describe(config_class(stage))]
    changed = [(stage, item) for stage, item in every if not item.expert]
    assert 10 <= len(changed) <= 20
    page, rest = generated_files()["docs/parameters.md"].split("The rest is below", 1)
    for stage, item in every:
        row = f"| `{stage}.{item.name}` |"
        assert (row in page) == (not item.expert)
        assert f"| `{item.name}` |" in rest
    for stage, item in changed:
        assert f"# Change it when {item.when}" in generated_files()[f"config/{stage}.yaml"]
        assert item.when.endswith(".") and item.when in page


@pytest.mark.parametrize("stage", NODES)
def test_parameter_file_loads_as_the_defaults(stage):
    values = yaml.safe_load(generated_files()[f"config/{stage}.yaml"])[stage]["ros__parameters"]
    assert load(config_class(stage), values) == config_class(stage)()


def test_setting_is_parsed_by_type():
    assert parse_setting("sync.window_s=0.01") == ("sync", "window_s", 0.01)


@pytest.mark.parametrize(
    ("argument", "told"),
    [
        ("sync.window=1", "unknown parameter 'window'"),
        ("nothing.x=1", "there is no stage 'nothing'"),
        ("sync.window_s", "write stage.parameter=value"),
        ("sync.window_s=wide", "'wide' is not a float"),
        ("sync.window_s=7", "above 1.0 s"),
    ],
)
def test_bad_setting_is_one_line_and_exit_code_2(argument, told, tmp_path, capsys):
    arguments = ["solve", "--rig", "r", "--detections", "d", "--out", str(tmp_path / "s"), "--set", argument]
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert told in error and error.count("\n") == 1
