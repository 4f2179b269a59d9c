"""Studies of rigs after Joo et al. 2017, 7.3, on simulated people.

The truth is exact, where the paper took the result of 480 cameras for it.
"""
