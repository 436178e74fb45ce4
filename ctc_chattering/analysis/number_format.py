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

"""Numbers as text: one place for how many digits are shown, and how."""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import Any

from markupsafe import Markup


def rounded(value: float, digits: int = 3) -> float:
    """Return a number to some digits."""
    return float(f'{value:.{digits}g}')


def shown(value: Any) -> str:
    """Return the value of a parameter in a sentence: numbers to four digits, several in []."""
    if isinstance(value, list):
        return f'[{", ".join("-" if x is None else f"{x:.4g}" for x in value)}]'
    return f'{value:.4g}' if isinstance(value, float) else str(value)


def measured(value: Any) -> str:
    """Return a measured number, or one for each joint, to three digits; ``-`` for None."""
    if value is None:
        return '-'
    items = value if isinstance(value, list) else [value]
    return ' '.join(f'{x:.3g}' if abs(x) < 100.0 else f'{x:.0f}' for x in items)


def short(value: float) -> str:
    """Return a number to four digits, in as few characters: ``0.05``, ``5e-4``."""
    plain = f'{value:.4g}'
    mantissa, exponent = f'{value:.3e}'.split('e')
    powers = f'{mantissa.rstrip("0").rstrip(".")}e{int(exponent)}'
    shorter = 0.0 < abs(value) < 0.01 and len(powers) < len(plain)
    return powers if shorter or 'e' in plain else plain


def span(low: float, high: float) -> str:
    """Return two numbers as a range, or one if they are equal."""
    return short(low) if low == high else f'{short(low)} to {short(high)}'


def scientific(value: float) -> str:
    """Return a number to three digits, with an exponent, that does not break at its sign."""
    mantissa, exponent = f'{value:.2e}'.split('e')
    return f'{mantissa}e{int(exponent)}'.removesuffix('e0').replace('-', '−')


def percent(part: int, whole: int) -> str:
    """Return a part of a number in per cent."""
    return f'{100.0 * part / whole:.1f} %'


def counted(n: int, noun: str) -> str:
    """Return a number of things; the plural of the noun ends in s."""
    return f'{n:,}'.replace(',', '\N{NARROW NO-BREAK SPACE}') + f' {noun}{"s"[:n != 1]}'


def number_text(value: float | Sequence[float], most: float = math.inf) -> str:
    """Return a number, or several, once if they are the same, as a range beyond `most`."""
    if not isinstance(value, (list, tuple)):
        return f'{value:g}'
    if len(set(value)) > most:
        return f'{min(value):g} to {max(value):g}'
    return f'{value[0]:g}' if len(set(value)) == 1 else '/'.join(f'{x:g}' for x in value)


def with_interval(value: float, half: float, unit: str = '') -> str:
    """Return a number to the digits that half its interval leaves, 3 to 6; 4 without one."""
    digits = 4
    if half and value:
        digits = min(max(len(f'{abs(value) / half:.0f}') + 1, 3), 6)
    interval = f' ± {half:.1g}' if half else ''
    return f'{value:.{digits}g}{interval} {unit}'.strip()


def in_field(value: Any) -> str:
    """Return the value of a parameter, of any type, as a field has it."""
    values = [value] if isinstance(value, str | bytes | int | float) else list(value)
    return ', '.join(f'{x:.12g}' if isinstance(x, float) else str(x) for x in values)


def in_html(value: float | None) -> Markup:
    """Return a number to three digits, with the exact value in the attribute."""
    if value is None:
        return Markup('<span class="none" title="none">–</span>')
    if 1e-5 <= abs(value) < 1e7:
        text = f'{value:.{max(0, 2 - math.floor(math.log10(abs(value))))}f}'
    else:
        text = f'{value:.2e}' if value else '0'
    return Markup('<data value="{!r}">{}</data>').format(value, text.replace('-', '−'))
