# Copyright 2026 The ctc_chattering maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Numba's undocumented functions, and `exec`.

`vectors.py`, `matrices.py`, `record_types.py` and `build.py` declare with its helpers how numba
compiles the operations of `compilable.py`. Beside these helpers they use what numba documents
(`numba.extending`). So a new version of numba can break nothing but what is here. Reasons:

- `numba.core.cgutils`: memory on the stack, elements of tuples and functions of C. numba documents
  no other way to write them.
- `numba.np.arrayobj`: an array over memory of ours. numba documents `carray` for pointers that C
  passes, not for addresses that are numbers.
- `numba.core.typing.templates`: the method ``_replace`` of NamedTuples takes keywords, which
  `overload_method` cannot declare.
- The library of a compiled function: numba documents no object file of a single function.
- `exec`: the constructor of a record takes its fields by position, and numba compiles no call of
  a number of arguments that it does not see in the text.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
import inspect
from typing import Any

from llvmlite import ir
import numba
from numba import types
from numba.core import cgutils
from numba.core.imputils import lower_builtin
from numba.core.typing import templates
from numba.core.typing.templates import AbstractTemplate, AttributeTemplate, infer_getattr
from numba.extending import intrinsic, overload
from numba.np.arrayobj import populate_array

DOUBLE = ir.DoubleType()
INT = ir.IntType(64)
#: Options of functions that compiled code alone calls: an entry for C takes a tenth of the time.
INTERNAL: Any = {'no_cfunc_wrapper': True}
#: Options of overloads. Strictly, numba would compare annotations.
OVERLOADED: Any = {'strict': False, 'jit_options': INTERNAL}
#: Options of the whole: without numba's memory, what would allocate an array is refused.
_ENTRY: Any = {'nogil': True, 'error_model': 'numpy', '_nrt': False,
               'no_cpython_wrapper': True, 'no_cfunc_wrapper': True}
Decorator = Callable[[Callable[..., Any]], Any]
#: Decorates a function of numba types that returns `instructions`.
lowered: Decorator = intrinsic
#: Decorates a function of numba types that returns what compiled code calls for another function.
overloaded: Callable[[Any], Decorator] = partial(overload, **OVERLOADED)


class InstructionWriter:
    """
    Writes LLVM instructions within one function.

    Attributes
    ----------
    builder : llvmlite.ir.IRBuilder
        Writes single instructions.

    """

    def __init__(self, context: Any, builder: Any) -> None:
        self._context = context
        self.builder = builder

    def call_c(self, name: str, result: Any, *values: Any) -> Any:
        """Call a function of the C library or of LLVM."""
        declaration = ir.FunctionType(result, [value.type for value in values])
        function = cgutils.get_or_insert_function(self.builder.module, declaration, name)
        return self.builder.call(function, values)

    def stack(self, memory: Any) -> Any:
        """Return a pointer to memory that lasts for the function."""
        return cgutils.alloca_once(self.builder, memory)

    def copy(self, source: Any, target: Any, count: int) -> None:
        """Copy so many floats from one pointer to another."""
        cgutils.memcpy(self.builder, target, source, ir.Constant(INT, count))

    def data(self, array: Any, value: Any) -> Any:
        """Return the pointer to the elements of an array."""
        return self._context.make_array(array)(self._context, self.builder, value).data

    def array_at(self, array: Any, address: Any, shape: Any) -> Any:
        """Return the array of a numba type at an address."""
        result = self._context.make_array(array)(self._context, self.builder)
        element = self._context.get_data_type(array.dtype)
        lengths = cgutils.unpack_tuple(self.builder, shape)
        size = ir.Constant(INT, self._context.get_abi_sizeof(element))
        strides = [size]
        for length in reversed(lengths[1:]):
            strides.insert(0, self.builder.mul(strides[0], length))
        data = self.builder.inttoptr(address, element.as_pointer())
        populate_array(result, data, lengths, strides, size, None)
        return result._getvalue()


def instructions(result: Any, arguments: Sequence[Any], emit: Callable[..., Any]) -> Any:
    """
    Return the signature and the code generator of an intrinsic.

    Parameters
    ----------
    result, arguments : numba types
        numba converts each argument to its type.
    emit : callable
        ``emit(writer, *values)`` writes them and returns the value of the result.

    """
    def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        value = emit(InstructionWriter(context, builder), *values)
        return context.get_dummy_value() if result == types.none else value
    return result(*arguments), generate


def defined(source: str, **names: Any) -> Any:
    """Return the function ``defined`` of a source text."""
    exec(source, names)
    return names['defined']


class _Replaced(AbstractTemplate):
    """Type of the method ``_replace`` of a record."""

    key = 'record._replace'

    def generic(self, _args: Any, kws: Any) -> Any:
        """Return the signature, with None for an unchanged field."""
        record = self.this  # type: ignore[attr-defined]
        fields = dict(zip(record.fields, record)) | kws
        result = types.BaseTuple.from_types(tuple(fields.values()), record.instance_class)
        parameters = [
            inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD, default=None)
            for name in record.fields]
        return templates.signature(
            result, *(kws.get(name, types.none) for name in record.fields), recvr=record,
        ).replace(pysig=inspect.Signature(parameters))


@infer_getattr
class _Replace(AttributeTemplate):

    key = types.BaseNamedTuple

    def resolve__replace(self, record: Any) -> Any:
        """Return the type of the method."""
        return types.BoundFunction(_Replaced, record)


@lower_builtin(  # type: ignore[untyped-decorator]
    _Replaced.key, types.BaseNamedTuple, types.VarArg(types.Any))
def _lower_replace(context: Any, builder: Any, signature: Any, values: Any) -> Any:
    record, *new_values = values
    old_values = cgutils.unpack_tuple(builder, record)
    return context.make_tuple(builder, signature.return_type, [
        old if argument is types.none else new
        for argument, old, new in zip(signature.args[1:], old_values, new_values)])


class CompiledFunction:
    """
    A function of an address, compiled by numba.

    Attributes
    ----------
    symbol : str
        Name of the function in LLVM.
    object_code, llvm_text : callable
        Return an object file with the function and all that it calls, as bytes, and the same in
        the language of LLVM.

    """

    def __init__(self, function: Callable[[int], int]) -> None:
        dispatcher = numba.njit(types.int64(types.int64), **_ENTRY)(function)
        result: Any = dispatcher.overloads[dispatcher.signatures[0]]
        self.symbol: str = result.fndesc.llvm_func_name
        self.object_code: Callable[[], bytes] = result.library._get_compiled_object
        self.llvm_text: Callable[[], str] = result.library.get_llvm_str
