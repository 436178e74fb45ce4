"""How numbers are shown."""

from __future__ import annotations

from ctc_chattering.analysis.number_format import (
    in_field,
    in_html,
    measured,
    number_text,
    rounded,
    shown,
    with_interval,
)
import pytest


@pytest.mark.parametrize(('text', 'wanted'), [
    (measured(None), '-'), (measured([1.23456e-5, 1234.5]), '1.23e-05 1234'),
    (shown([0.5, 12.34567]), '[0.5, 12.35]'), (shown(True), 'True'),
    (number_text((8.0, 8.0)), '8'), (number_text([8.0, 9.5]), '8/9.5'),
    (in_field([0.1 + 0.2, 1]), '0.3, 1'), (in_field('sign'), 'sign'),
    (with_interval(1.23456, 0.0, 'N*m'), '1.235 N*m'),
    (with_interval(1.23456, 0.0123, 'N*m'), '1.235 ± 0.01 N*m'),
    (with_interval(1.23456, 9.0), '1.23 ± 9'),
    (in_html(None), '<span class="none" title="none">–</span>'),
    (in_html(-1234.5), '<data value="-1234.5">−1234</data>'),
    (in_html(1e-9), '<data value="1e-09">1.00e−09</data>')])
def test_text(text: str, wanted: str) -> None:
    assert text == wanted


def test_rounded_keeps_the_digits_asked_for() -> None:
    assert rounded(123456.0) == 123000.0
    assert rounded(1.23456789, 6) == 1.23457
