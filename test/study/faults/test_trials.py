"""An exception is put down to the code that it came from, not to the code that damages files."""

from panoptic_ros.study.faults.trials import _place


def function(path, body):
    """Return the function `f` of a module at a path."""
    names = {}
    exec(compile(f"def f(inner=None):\n    {body}\n", path, "exec"), names)
    return names["f"]


def test_frames_of_the_damaging_code_are_left_out():
    damaging = function("/x/panoptic_ros/study/faults/mutations.py", "raise ValueError")
    reading = function("/x/panoptic_ros/io/bags.py", "inner()")
    try:
        reading(damaging)
    except ValueError as error:
        assert _place(error) == "bags.py:2"
