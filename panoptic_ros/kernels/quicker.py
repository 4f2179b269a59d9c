"""What numba works out again and again while it compiles, remembered: a sixth of the time that it takes.

The type of an operation depends on the operation, the types of its arguments and the flags alone, but numba
tries all of its templates at every place. The variables of an instruction are looked for in a recursion that
is asked for all of its attributes, nine times for each function. Every assignment of an array to a part of
another brings with it all that it takes to write both shapes into the error's text: a plain text serves.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import ir
from numba.core.targetconfig import ConfigStack
from numba.core.types.functions import BaseFunction
from numba.extending import overload
from numba.np import arrayobj

_find_call_type = BaseFunction.get_call_type
_found: dict[Any, Any] = {}  # signatures; the types in its keys are kept by numba as well
_kinds: dict[type, int] = {}
OTHER, VARIABLE, INSTRUCTION, SEQUENCE, MAPPING = range(5)


@contextmanager
def quicker() -> Iterator[None]:
    """While this holds, numba remembers. Only one thread compiles at a time."""
    names: tuple[tuple[Any, str, Any], ...] = (
        (BaseFunction, "get_call_type", _call_type),
        (ir.Inst, "_rec_list_vars", _variables),
        (arrayobj, "raise_with_shape_context", _refuse_shapes),
    )
    before = [getattr(owner, name) for owner, name, _ in names]
    for owner, name, function in names:
        setattr(owner, name, function)
    try:
        yield
    finally:
        for (owner, name, _), function in zip(names, before):
            setattr(owner, name, function)


def _refuse_shapes(src_shapes: Any, index_shape: Any) -> None:
    """In place of `arrayobj.raise_with_shape_context`."""
    raise NotImplementedError


@overload(_refuse_shapes)
def _refusal(src_shapes: Any, index_shape: Any) -> Any:
    def refuse(src_shapes: Any, index_shape: Any) -> None:
        raise ValueError("an array is assigned to a part of another shape")

    return refuse


def _call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
    """In place of `BaseFunction.get_call_type`; failures are not remembered."""
    key = self, context, args, tuple(kws.items()), ConfigStack.top_or_none()
    signature = _found.get(key)
    if signature is None:
        signature = _found[key] = _find_call_type(self, context, args, kws)
    return signature


def _variables(self: Any, value: Any) -> list[Any]:
    """In place of `Inst._rec_list_vars`."""
    found: list[Any] = []
    for each in value.values() if type(value) is dict else (value,):
        kind = _kinds.get(type(each))
        if kind is None:
            kind = _kinds[type(each)] = _kind_of(each)
        if kind == VARIABLE:
            found.append(each)
        elif kind == INSTRUCTION:
            found.extend(each.list_vars())
        elif kind != OTHER:
            for part in each.values() if kind == MAPPING else each:
                found.extend(_variables(self, part))
    return found


def _kind_of(value: Any) -> int:
    kinds = {ir.Var: VARIABLE, ir.Inst: INSTRUCTION, list: SEQUENCE, tuple: SEQUENCE, dict: MAPPING}
    return next((kind for cls, kind in kinds.items() if isinstance(value, cls)), OTHER)
