"""Kernels are compiled as wholes: this numba allows it, they compute and raise alike, parts keep no code."""

import configparser
import re
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core import ir
from numba.core.types.functions import BaseFunction

from panoptic_ros.kernels import cache, on_compilation, parts, quicker

pytestmark = pytest.mark.skipif(not cache.IS_KNOWN, reason=parts.slow_compilation())


def plain(function):
    return parts.Kernel(function, {"nopython": True, "no_cfunc_wrapper": True})


@plain
def root(x):
    if x < 0.0:
        raise ValueError("a negative number")
    return np.sqrt(x)


@plain
def roots(values):
    found = np.empty(len(values))
    for i in range(len(values)):
        found[i] = root(values[i])
    return found


def test_versions_of_numba_that_nobody_has_read_are_not_installed():
    """For another one: read what parts.py and quicker.py take from it, run the tests, name it in `KNOWN`."""
    declared = configparser.ConfigParser()
    declared.read(Path(__file__).parents[2] / "setup.cfg")
    (numba_line,) = re.findall(r"^numba.*", declared["options"]["install_requires"], re.M)
    newest = max(tuple(map(int, version.split("."))) for version in cache.KNOWN)
    assert numba_line.endswith(f"<{newest[0]}.{newest[1] + 1}")


def test_wholes_and_parts_compute_the_same():
    values = np.linspace(0.0, 9.0, 7)
    np.testing.assert_array_equal(roots(values), np.sqrt(values))
    assert [root(x) for x in values] == list(roots(values))


def test_errors_pass_from_parts_to_whoever_calls():
    for _ in range(2):
        with pytest.raises(ValueError, match="a negative number"):
            roots(np.array([1.0, -1.0]))
        with pytest.raises(ValueError, match="a negative number"):
            root(-1.0)


def test_parts_have_no_machine_code():
    roots(np.ones(2))
    (result,) = root.part.overloads.values()
    function = result.library._get_module_for_linking().get_function(result.fndesc.llvm_func_name)
    assert not function.is_declaration
    with pytest.raises(RuntimeError, match="no compiled object"):
        result.library._get_compiled_object()


def test_a_part_is_compiled_once_for_all_of_its_callers():
    @plain
    def part(x):
        return x + 1.0

    @plain
    def one(x):
        return part(x)

    @plain
    def two(x):
        return 2.0 * part(x)

    compiled = []
    with on_compilation(compiled.append):
        assert (one(1.0), two(1.0)) == (2.0, 4.0)
    assert [name.rpartition(".")[2] for name in compiled] == ["one", "part", "two"]


def test_numbas_own_kernels_are_left_as_they_are():
    @numba.njit
    def foreign(values):
        return np.zeros_like(values) + root(4.0)

    assert list(foreign(np.ones(2))) == [2.0, 2.0]
    with pytest.raises(ValueError, match="a negative number"):
        numba.njit(lambda x: root(x))(-1.0)


def test_variables_and_types_are_remembered_only_while_kernels_compile():
    before = BaseFunction.get_call_type, ir.Inst._rec_list_vars
    with quicker.quicker():
        assert (BaseFunction.get_call_type, ir.Inst._rec_list_vars) != before
    with pytest.raises(ZeroDivisionError), quicker.quicker():
        raise ZeroDivisionError
    assert (BaseFunction.get_call_type, ir.Inst._rec_list_vars) == before


def test_the_variables_of_an_instruction_are_those_that_numba_finds():
    place = ir.Loc("here", 1)
    a, b, c = (ir.Var(None, name, place) for name in "abc")
    call = ir.Expr.call(a, (b, c), {"key": b}, place)
    for instruction in (call, ir.Assign(call, c, place), ir.Expr.build_map([(a, b)], 1, {}, {}, place)):
        expected = instruction.list_vars()
        with quicker.quicker():
            assert instruction.list_vars() == expected
    assert len(call.list_vars()) == 4


def test_a_call_that_does_not_fit_fails_each_time():
    @plain
    def wrong(values):
        return values + "text"

    for _ in range(2):
        with pytest.raises(numba.TypingError):
            wrong(1.0)


def test_another_version_of_numba_compiles_as_it_does_and_says_so():
    program = (
        "import numba; numba.__version__ = '0.1.0'\n"
        "from panoptic_ros.kernels import njit, slow_compilation\n"
        "kernel = njit(error_model='numpy')(lambda x: x + 1.0)\n"
        "print(kernel(2.0), type(kernel).__module__.partition('.')[0])\n"
        "print(slow_compilation())\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    first, note = done.stdout.splitlines()
    assert first == "3.0 numba"
    assert note.startswith("numba 0.1.0 is none of")
    assert done.stderr == ""
