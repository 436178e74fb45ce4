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
One object file of several functions, for C.

`c_export/library.py` makes libraries of laws with it. It takes functions as `build` compiles them
for this computer. LLVM links them, and writes code for the processor of the library, which needs
nothing but the C library.
"""

from __future__ import annotations

from collections.abc import Mapping
import subprocess
import sys

from ctc_chattering.compiled.build import compiled
from ctc_chattering.compiled.machine_code import Code
from ctc_chattering.errors import CtcError, UsageError
from llvmlite import binding

#: Functions of the C library that compiled code may call.
_LIBRARY = {'cbrt', 'cos', 'exp', 'floor', 'fmod', 'log', 'memcpy', 'memmove', 'memset', 'pow',
            'sin', 'sqrt', 'tanh'}
#: Name for the processor of this computer.
HOST = 'host'
#: Script that makes code for a processor. LLVM writes to stderr what is wrong with its name.
_PROBE = """
import sys
from llvmlite import binding
for start in (binding.initialize_native_target, binding.initialize_native_asmprinter):
    try:
        start()
    except RuntimeError:  # Newer versions do it by themselves.
        continue
machine = binding.Target.from_default_triple().create_target_machine(sys.argv[1])
machine.emit_object(binding.parse_assembly('define void @f() { ret void }'))
"""


def check_processor(processor: str) -> None:
    """
    Raise unless LLVM knows a processor. Another process asks, since LLVM aborts otherwise.

    Raises
    ------
    UsageError
        If LLVM does not know it, or it is of another kind.

    """
    if processor == HOST:
        return
    done = subprocess.run([sys.executable, '-c', _PROBE, processor], capture_output=True,
                          check=False)
    if done.returncode or done.stderr:
        raise UsageError(f'--processor {processor}: not allowed; allowed: {HOST}, and names of '
                         '`llc -mcpu=help` for machines of this kind, such as x86-64-v3')


def object_file(codes: Mapping[str, Code], processor: str = HOST) -> tuple[bytes, str]:
    """
    Return an object file of functions, and its LLVM text.

    The code is independent of its position. No other names are visible. The same functions give
    the same bytes. Numbers are those of `build`, since nothing is computed in another order.

    Parameters
    ----------
    codes : mapping of str to Code
        Functions by their names in C: ``int name(int64_t *result, void **error, int64_t places)``.
    processor : str
        Name as of ``llc -mcpu``, such as x86-64-v3, or `HOST`.

    """
    module, *modules = [_module(name, code) for name, code in codes.items()]  # Initializes LLVM.
    cpu = processor
    features = ''
    if processor == HOST:
        cpu = binding.get_host_cpu_name()
        features = binding.get_host_cpu_features().flatten()
    target = binding.Target.from_default_triple()
    machine = target.create_target_machine(cpu, features, opt=3, reloc='pic', codemodel='small')
    for linked in modules:
        module.link_in(linked)
    passes = binding.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(module, binding.create_pass_builder(
        machine, binding.create_pipeline_tuning_options(speed_level=0)))
    unknown = {x.name for x in module.functions if x.is_declaration
               and not x.name.startswith('llvm.')} - _LIBRARY
    if unknown:
        raise CtcError(f'compiled code calls {", ".join(sorted(unknown))}, not of the C library')
    return machine.emit_object(module), str(module)


def _module(name: str, code: Code) -> binding.ModuleRef:
    """Return the module of a function, with internal names otherwise."""
    function = compiled(code)
    module = binding.parse_assembly(function.llvm_text())
    for number, value in enumerate((*module.functions, *module.global_variables)):
        if value.name == function.symbol:
            value.name = name
            value.visibility = 'hidden'
        elif not value.is_declaration:
            value.name = f'{name}_{number}'
            value.linkage = 'internal'
    return module
