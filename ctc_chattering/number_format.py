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
Numbers as text, and numbers rounded to significant digits.

Messages, terminals and pages use them.

Every folder of the package may use this module. A sentence with one number to fixed digits
does not need it: an f-string such as ``f'{x:.3g}'`` is enough.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import math

Scalar = str | bytes | int | float


def format_number(value: float | None, digits: int = 3) -> str:
    """
    Return a number to significant digits.

    None becomes ``-``.

    Below ten million, all digits before the point are shown: 1234 instead of 1.23e+03.
    """
    if value is None:
        return '-'
    if 10.0 ** (digits - 1) <= abs(value) < 1e7:
        return f'{value:.0f}'
    return f'{value:.{digits}g}'


def format_numbers(
    values: float | Sequence[float | None] | None, digits: int = 3, separator: str = ' '
) -> str:
    """Return one number, or several with a separator between them."""
    items = [values] if values is None or isinstance(values, int | float) else values
    return separator.join(format_number(x, digits) for x in items)


def format_decimal(value: float) -> str:
    """
    Return a number to three digits, with trailing zeros.

    Columns of a table need them.
    """
    if 1e-5 <= abs(value) < 1e7:
        decimals = max(0, 2 - math.floor(math.log10(abs(value))))
        return f'{value:.{decimals}f}'
    return f'{value:.2e}' if value else '0'


def format_joint_values(values: float | Sequence[float], max_count: float = math.inf) -> str:
    """
    Return the numbers of all joints.

    It is one number if all are equal, and a range if too many differ.
    """
    distinct = {values} if isinstance(values, int | float) else set(values)
    if len(distinct) == 1:
        return format_number(distinct.pop(), 6)
    if len(distinct) > max_count:
        return f'{format_number(min(distinct), 6)} to {format_number(max(distinct), 6)}'
    return format_numbers(values, 6, '/')


def format_value(value: Scalar | Sequence[Scalar | None], digits: int = 4) -> str:
    """
    Return the value of a parameter of any type.

    Several values have commas between them.
    """
    items = [value] if isinstance(value, Scalar) else value
    return ', '.join(
        format_number(x, digits) if x is None or isinstance(x, float) else str(x) for x in items
    )


def format_interval(value: float, half_width: float, unit: str = '') -> str:
    """
    Return a number with the half width of its interval.

    The interval decides on the number's digits, 3 to 6. Without an interval there are 4.
    """
    digits = 4
    if half_width and value:
        ratio = abs(value) / half_width
        digits = min(max(len(f'{ratio:.0f}') + 1, 3), 6)
    # The half width never has a power of ten, such as 1e+01.
    interval = f' ± {round_number(half_width, 1):.6g}' if half_width else ''
    return f'{value:.{digits}g}{interval} {unit}'.strip()


def format_count(count: int, noun: str) -> str:
    """
    Return a number of things, such as 2 runs.

    The plural of the noun ends in s.
    """
    digits = f'{count:,}'.replace(',', '\N{NARROW NO-BREAK SPACE}')
    return f'{digits} {noun}' if count == 1 else f'{digits} {noun}s'


def round_number(value: float, digits: int = 3) -> float:
    """Return a number rounded to significant digits."""
    return float(f'{value:.{digits}g}')


def round_towards(value: float, digits: int, rounding: Callable[[float], int]) -> float:
    """
    Return a number rounded up or down to significant digits.

    Parameters
    ----------
    value : float
        Infinite values and those that are not positive stay as they are.
    digits : int
        Significant digits, 6 or fewer.
    rounding : callable
        `math.ceil` or `math.floor`.

    """
    if not 0.0 < value < math.inf:
        return value
    unit = 10.0 ** (math.floor(math.log10(value)) - digits + 1)
    # Without the inner rounding, 12.000000000001 units would become 13.
    units = rounding(round(value / unit, 9))
    return round_number(units * unit, 6)
