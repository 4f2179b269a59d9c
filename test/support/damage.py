"""Messages as a broken writer might send them."""

from __future__ import annotations

from typing import Any

import numpy as np

COUNTS = (0, 1, 2, 255, 2**31 - 1, 2**32 - 1, 10**9)
NUMBERS = (0.0, -1.0, 1e-300, 5e5, 1e9, 1e160, -1e160, np.nan, np.inf, -np.inf)


def damage(message: Any, rng: np.random.Generator) -> str:
    """Change one field somewhere inside of a message of `bag_messages()`; its name."""
    while True:
        names = [field for field in message.__dataclass_fields__ if field != "__msgtype__"]
        name = str(rng.choice(names))
        value = getattr(message, name)
        if isinstance(value, list) and value and hasattr(value[0], "__msgtype__") and rng.random() < 0.8:
            value = value[rng.integers(len(value))]
        if not hasattr(value, "__msgtype__"):
            object.__setattr__(message, name, damaged(value, rng))
            return name
        message = value


def damaged(value: Any, rng: np.random.Generator) -> Any:
    """A value of the same kind."""
    if isinstance(value, np.ndarray):
        return _damaged_array(value, rng)
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return int(rng.choice([*COUNTS, min(value + 1, 2**31)]))
    if isinstance(value, float):
        return float(rng.choice(NUMBERS))
    if isinstance(value, str):
        return str(rng.choice(["", "nobody", "cam1"]))
    return value[:-1] if value and rng.random() < 0.5 else [*value, *value[:1]]


def _damaged_array(value: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    if not value.size:
        return np.ones(1, value.dtype)
    changed = value.copy()
    what = NUMBERS if value.dtype.kind == "f" else [c for c in COUNTS if c <= np.iinfo(value.dtype).max]
    with np.errstate(over="ignore"):
        changed[rng.integers(value.size, size=rng.integers(1, 4))] = rng.choice(np.array(what, value.dtype))
    return [value[:-1], np.append(value, value[:1]), changed, changed][rng.integers(4)]
