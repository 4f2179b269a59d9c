"""The value of every mechanism of the core: each is off in turn, and the same people are solved again.

`mechanisms` is the table of mechanisms and of the parameters that switch them off, `figures` are the scores
of one solution, `differences` compares solutions pair by pair, `ablation` is the study.
"""
