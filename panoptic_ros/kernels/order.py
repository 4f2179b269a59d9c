"""Order of numbers, compiled: quicker to compile by far than numba's own, which serve all types and NaN."""

from __future__ import annotations

import numpy as np

from panoptic_ros.kernels.jit import njit

Array = np.ndarray
_jit = njit(cache=True, error_model="numpy", nogil=True)


@_jit
def nth_smallest(values: Array, n: int) -> float:
    """The n-th smallest, from 0, of finite numbers (N,), which are reordered: those before it are no larger.

    Hoare's selection, in linear time on average.
    """
    low, high = 0, len(values) - 1
    while low < high:
        pivot = values[(low + high) // 2]
        i, k = low, high
        while i <= k:
            while values[i] < pivot:
                i += 1
            while values[k] > pivot:
                k -= 1
            if i <= k:
                values[i], values[k] = values[k], values[i]
                i += 1
                k -= 1
        if n <= k:
            high = k
        elif n >= i:
            low = i
        else:
            break
    smallest: float = values[n]
    return smallest


@_jit
def median(values: Array) -> float:
    """Median of finite numbers (N,), at least one, which are reordered; of two in the middle, their mean."""
    half = len(values) // 2
    upper = nth_smallest(values, half)
    if len(values) % 2:
        return upper
    lower = values[0]
    for i in range(1, half):
        lower = max(lower, values[i])
    middle: float = (lower + upper) / 2.0
    return middle


@_jit
def descending(values: Array) -> Array:
    """Indices (N,) that sort numbers (N,) from the largest down; equal ones stay in order (merge sort)."""
    count = len(values)
    order, merged = np.empty(count, np.int64), np.empty(count, np.int64)
    for i in range(count):
        order[i] = i
    width = 1
    while width < count:
        for begin in range(0, count, 2 * width):
            middle, end = min(begin + width, count), min(begin + 2 * width, count)
            i, k = begin, middle
            for place in range(begin, end):
                if i < middle and (k >= end or not values[order[k]] > values[order[i]]):
                    merged[place] = order[i]
                    i += 1
                else:
                    merged[place] = order[k]
                    k += 1
        order, merged = merged, order
        width *= 2
    return order
