"""Parameters refuse what they should and survive every way out and back."""

from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from panoptic_ros.errors import ConfigError, ContractError
from panoptic_ros.params import Config, config_of, describe, diff, from_text, load, param, to_mapping


@dataclass(frozen=True, kw_only=True)
class Sample(Config):
    size_m: float = param(0.04, unit="m", ge=0.01, le=1.0, doc="Size.", when="people are small.")
    count: int = param(3, ge=1, doc="Count.")
    method: str = param("quick", choices=("quick", "exact"), doc="Method.")
    on: bool = param(True, doc="Whether.")
    names: tuple[str, ...] = param((), doc="Names.")
    weights: tuple[float, ...] = param((1.0,), doc="Weights.")


def test_description():
    rows = {item.name: item for item in describe(Sample)}
    assert rows["size_m"].unit == "m" and rows["size_m"].le == 1.0 and rows["names"].default == ()


def test_what_nobody_says_when_to_change_is_for_experts():
    rows = {item.name: item for item in describe(Sample)}
    assert not rows["size_m"].expert and rows["size_m"].told == "Size."
    assert rows["count"].expert and rows["count"].told == "Expert: Count."


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("size_m", 2.0, "above 1.0 m"),
        ("size_m", 0.0, "below 0.01 m"),
        ("size_m", "x", "not a float"),
        ("size_m", float("nan"), "not finite"),
        ("count", 1.5, "not a int"),
        ("count", True, "not a int"),
        ("method", "best", "none of quick, exact"),
        ("on", 1, "not a bool"),
        ("names", "ab", "not a list"),
        ("names", [1], "not a str"),
    ],
)
def test_bad_value_is_refused_by_name(name, value, told):
    with pytest.raises(ConfigError, match=f"Sample.{name}.*{told}"):
        load(Sample, {name: value})


def test_unknown_name_is_refused_with_the_known_ones():
    with pytest.raises(ConfigError, match="'sise'.*size_m"):
        load(Sample, {"sise": 1.0}, where="")


@given(st.floats(0.01, 1.0), st.integers(1, 1000), st.lists(st.floats(-1e6, 1e6), max_size=4))
def test_mapping_round_trip(size, count, weights):
    config = Sample(size_m=size, count=count, weights=tuple(weights))
    assert load(Sample, to_mapping(config)) == config
    assert load(Sample, diff(config)) == config


def test_integers_serve_as_floats():
    assert load(Sample, {"size_m": 1}).size_m == 1.0


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("size_m", "0.5", 0.5),
        ("on", "false", False),
        ("names", "a, b", ("a", "b")),
        ("weights", "1,2.5", (1.0, 2.5)),
        ("names", "[a, b]", ("a", "b")),
        ("weights", "[]", ()),
        ("names", '["mic=A,", "line=B,C"]', ("mic=A,", "line=B,C")),
        ("names", "['a,b']", ("a,b",)),
    ],
)
def test_text(name, text, value):
    assert from_text(Sample, name, text) == value


def test_a_quotation_without_its_end_is_told():
    with pytest.raises(ConfigError, match="is not a list of str"):
        from_text(Sample, "names", '["a, b')


def test_field_without_param_is_a_bug():
    @dataclass(frozen=True, kw_only=True)
    class Plain(Config):
        x: int = 1

    with pytest.raises(ContractError):
        describe(Plain)


def test_a_configuration_is_found_by_its_class():
    class Other(Sample):
        pass

    configs = {"first": Other(), "second": Sample(size_m=0.5)}
    assert config_of(configs, Sample).size_m == 0.5
    assert config_of(configs, Other) is configs["first"]
    with pytest.raises(ContractError, match="no Sample among the configurations of first"):
        config_of({"first": Other()}, Sample)
