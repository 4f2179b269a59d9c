"""Which functions of a module lack annotations, and which of these numba compiles."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache

COMPILERS = frozenset({"inlined", "njit"})


@cache  # several tests ask about all modules
def unannotated(source: str) -> tuple[tuple[str, bool], ...]:
    """Name, and whether numba compiles it, of every function without all of its annotations."""
    tree = ast.parse(source)
    compilers = COMPILERS | set(_own_compilers(tree))
    return tuple(
        (node.name, any(_called(each) in compilers for each in node.decorator_list))
        for node in ast.walk(tree)
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)) and not _is_annotated(node)
    )


def _own_compilers(tree: ast.Module) -> Iterator[str]:
    """Names that a module gives to njit with options: `_jit = njit(cache=True)`."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and _called(node.value) in COMPILERS:
            yield from (target.id for target in node.targets if isinstance(target, ast.Name))


def _called(node: ast.expr) -> str:
    """ "njit" of njit, njit(...) and numba.njit(...)."""
    while isinstance(node, ast.Call):
        node = node.func
    return node.attr if isinstance(node, ast.Attribute) else getattr(node, "id", "")


def _is_annotated(node: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    every = (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)
    given = [each for each in every if each.arg not in ("self", "cls")]
    typed = all(each.annotation is not None for each in given)
    return typed and (node.returns is not None or (node.name == "__init__" and bool(given)))
