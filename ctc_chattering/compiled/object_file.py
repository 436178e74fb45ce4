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

"""One object file for C of several functions, which needs nothing but the C library."""

from __future__ import annotations

from collections.abc import Mapping
import subprocess
import sys

from ctc_chattering.compiled.build import compiled
from ctc_chattering.compiled.machine_code import Code
from ctc_chattering.errors import CtcError, UsageError
from llvmlite import binding

#: What compiled code calls of the C library.
_LIBRARY = {'cbrt', 'cos', 'exp', 'floor', 'fmod', 'log', 'memcpy', 'memmove', 'memset', 'pow',
            'sin', 'sqrt', 'tanh'}
#: The processor of this computer.
HOST = 'host'
#: Makes code for a processor. LLVM writes to stderr what is wrong with its name, or ends.
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
    Raise unless code can be made for a processor: LLVM would end this process.

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
    Return an object file of functions, and the same in the language of LLVM.

    The code is independent of its position. No other names are visible; the same functions give
    the same bytes. Numbers are those of `build`: nothing is computed in another order.

    Parameters
    ----------
    codes : mapping of str to Code
        Functions by their names in C: ``int name(int64_t *result, void **error, int64_t places)``.
    processor : str
        As ``llc -mcpu`` names them, such as x86-64-v3; `HOST` for this one.

    """
    parts = [_part(name, code) for name, code in codes.items()]
    if processor == HOST:
        cpu, features = binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten()
    else:
        cpu, features = processor, ''
    target = binding.Target.from_default_triple()
    machine = target.create_target_machine(cpu, features, opt=3, reloc='pic', codemodel='small')
    module, *others = parts
    for part in others:
        module.link_in(part)
    passes = binding.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(module, binding.create_pass_builder(
        machine, binding.create_pipeline_tuning_options(speed_level=0)))
    unknown = {x.name for x in module.functions if x.is_declaration
               and not x.name.startswith('llvm.')} - _LIBRARY
    if unknown:
        raise CtcError(f'compiled code calls {", ".join(sorted(unknown))}, not of the C library')
    return machine.emit_object(module), str(module)


def _part(name: str, code: Code) -> binding.ModuleRef:
    """Return the module of a function, all others in it being internal and numbered."""
    made = compiled(code)
    part = binding.parse_assembly(made.library.get_llvm_str())
    for number, value in enumerate((*part.functions, *part.global_variables)):
        if value.name == made.fndesc.llvm_func_name:
            value.name, value.visibility = name, 'hidden'
        elif not value.is_declaration:
            value.name, value.linkage = f'{name}_{number}', 'internal'
    return part
