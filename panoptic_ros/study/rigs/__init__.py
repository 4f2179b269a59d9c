"""Studies of camera rigs after Joo et al. 2017, section 7.3, on simulated persons.

The ground truth is exact. The paper used the result of 480 cameras as ground truth instead.
"""
