"""The study of the value of every mechanism of the core: switch off one at a time and solve again.

All runs use the same 2D poses. `mechanisms` is the table of mechanisms and of the parameters that switch them
off. `figures` computes the scores of one solution, `differences` compares solutions pair by pair, and
`ablation` is the study.
"""
