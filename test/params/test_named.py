"""Numbers by name."""

import pytest

from panoptic_ros.errors import ConfigError
from panoptic_ros.params import named_numbers, named_words, of_name


def test_named_numbers_and_their_default():
    values = named_numbers("x", ["cam01=8.3", " * = 4 "])
    assert [of_name(values, name) for name in ("cam01", "other")] == [8.3, 4.0]
    assert of_name(named_numbers("x", []), "other") == 0.0
    assert named_words("x", ["a=b"]) == {"a": "b"}


@pytest.mark.parametrize("entries", [["cam"], ["cam=x"], ["cam=nan"], ["=3"], ["a=1", "a=2"]])
def test_what_is_no_number_of_a_name_is_told(entries):
    with pytest.raises(ConfigError, match="x"):
        named_numbers("x", entries)
