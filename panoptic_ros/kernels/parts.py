"""Compiling whole kernels: what only kernels call is compiled with its callers, never on its own.

numba makes machine code of every function, of each kernel that only kernels call and of each of its own that
a kernel uses (`np.empty` and the like), though it compiles them again inside of every caller. Here they are
handed to their callers as LLVM's code, and each is optimised in one go: a third less processor time, for
kernels that run as fast and give the same bytes.

This stands on parts of numba that are its own. They are known to be as expected in the versions of
`cache.KNOWN`; with others, kernels compile as numba does it, and `slow_compilation` says so.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numba
from numba.core import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, Flags
from numba.core.environment import lookup_environment
from numba.core.registry import CPUDispatcher

from panoptic_ros.kernels.cache import IS_KNOWN, KNOWN
from panoptic_ros.kernels.quicker import quicker

OWN_FLAGS = ("release_gil", "no_cpython_wrapper", "no_cfunc_wrapper")  # not handed down to what it calls
ENVIRONMENT = "_ZN08NumbaEnv"  # how the names of numba's environments begin


def slow_compilation() -> str:
    """Why kernels take longer to compile than they need; empty if they do not."""
    if IS_KNOWN:
        return ""
    return f"numba {numba.__version__} is none of {', '.join(KNOWN)}: kernels run, but take longer to compile"


class Kernel(CPUDispatcher):
    """A compiled function: for calls from Python machine code, for calls from kernels a part of them."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]):
        super().__init__(function, targetoptions=options, pipeline_class=_WholeCompiler)
        part_options = {**options, "no_cpython_wrapper": True}
        self.part = CPUDispatcher(function, targetoptions=part_options, pipeline_class=_PartCompiler)

    @property
    def _numba_type_(self) -> Any:
        """What kernels see of it."""
        return types.Dispatcher(self.part)


class _Library(JITCodeLibrary):
    """Code that is optimised in one go; numba's own way begins with two shorter ones."""

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        manager, builder = self._codegen._module_pass_manager()
        manager.run(self._final_module, builder)


class _WholeLibrary(_Library):
    """Machine code with all of its parts."""

    def _finalize_specific(self) -> None:
        super()._finalize_specific()
        codegen: Any = self._codegen
        names = (variable.name for variable in self._final_module.global_variables)
        for name in names:
            environment = lookup_environment(name) if name.startswith(ENVIRONMENT) else None
            if environment is not None:
                codegen.set_env(name, environment)


class _PartLibrary(_Library):
    """Code to be linked into callers, without machine code."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> Any:
        return _NoEnvironments


class _NoEnvironments:
    @staticmethod
    def set_env(name: str, environment: Any) -> None:
        """The whole that a part is linked into sets it."""


class _Flags(Flags):
    """Flags that are quick to compare, by what is handed down: numba does so at every operation."""

    def __init__(self, flags: Any):
        super().__init__(flags)
        inherited = Flags(flags)
        for name in OWN_FLAGS:
            inherited.discard(name)
        self._key = inherited.summary()

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return self._key == other._key if isinstance(other, _Flags) else bool(super().__eq__(other))


class _Compiler(Compiler):
    library: type[JITCodeLibrary]

    def compile_extra(self, func: Callable[..., Any]) -> Any:
        codegen = self.state.targetctx.codegen()
        self.state.library = self.library(codegen, func.__qualname__)
        self.state.library.enable_object_caching()
        self.state.flags = _Flags(self.state.flags)
        with _only_parts(codegen), quicker():
            return super().compile_extra(func)


class _WholeCompiler(_Compiler):
    library = _WholeLibrary


class _PartCompiler(_Compiler):
    library = _PartLibrary


@contextmanager
def _only_parts(codegen: Any) -> Iterator[None]:
    """While this holds, functions of numba's own are parts too. Only one thread compiles at a time."""
    before = codegen._library_class
    codegen._library_class = _PartLibrary
    try:
        yield
    finally:
        codegen._library_class = before
