"""What every mechanism of the core is worth: each is off in turn, and the same people are solved again.

`mechanisms` is the table of what is switched and how, `worlds` makes or reads what is solved, `case` solves
one world with every mechanism off in turn (in a process of its own), `figures` are the scores of one
solution, `differences` and `summary` compare them pair by pair, `command` and `table` are what
`panoptic bench ablation` calls.
"""

from panoptic_ros.bench.ablation.command import add_arguments, measure
from panoptic_ros.bench.ablation.table import lines

__all__ = ["add_arguments", "lines", "measure"]
