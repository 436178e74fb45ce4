"""docs/laws.md has every law with its parameters, and ranges that hold."""

from __future__ import annotations

from pathlib import Path
import re

import numpy as np
import pytest

from ctc_chattering.control.controller import ControllerConfig, LAWS
from ctc_chattering.control.handover import FADE
from ctc_chattering.control.laws.registry import law_class

PAGE = (Path(__file__).resolve().parents[2] / 'docs' / 'laws.md').read_text(encoding='utf-8')


def rows() -> list[list[str]]:
    """Return the cells of the table of laws."""
    lines = PAGE[PAGE.index('| `law` |'):].split('\n\n')[0].splitlines()[2:]
    return [[cell.strip() for cell in re.split(r'(?<!\\)\|', line.strip().strip('|'))]
            for line in lines]


def test_the_table_has_every_law_with_its_parameters() -> None:
    assert [row[0].strip('`') for row in rows()] == list(LAWS)
    declared = {law: {name for name, spec in ControllerConfig.parameters().items()
                      if law in spec.laws} for law in LAWS}
    for law, _, _, parameters, _ in rows():
        assert set(re.findall(r'`(\w+)`', parameters)) == declared[law.strip('`')]


def test_every_law_has_a_paragraph_and_every_module_a_reference() -> None:
    for law in LAWS:
        assert f'**`{law}`' in PAGE
        text = __import__(law_class(law).__module__, fromlist=['']).__doc__ or ''
        assert re.search(r'\b(19|20)\d\d\b|of the paper', text)
        assert text.startswith(f'\nLaw `{law}`')
        assert '(1)' in text or '(2)' in text or '(6)' in text


def test_the_time_of_fading_is_that_of_the_code() -> None:
    assert f'fades linearly within {FADE:g} s' in PAGE


@pytest.mark.parametrize('scale', [0.99, 1.01])
def test_the_fastest_triple_pole(scale: float) -> None:
    """Check p < 2 / (3 h) sampled, and p < 8 / (9 T) with a lag, by eigenvalues."""
    h, p = 1e-3, scale * 2.0 / 3e-3
    gains = np.array([3 * p * p, 3 * p, 1.0])
    sampled = np.array([[1, h, 0], [0, 1, 0], [h * p ** 3, 0, 1]]) - np.outer(
        [h * h / 2, h, 0], gains)
    assert (np.abs(np.linalg.eigvals(sampled)).max() < 1.0) == (scale < 1.0)
    lag = 2e-3
    p = scale * 8.0 / (9.0 * lag)
    roots = np.roots([lag, 1.0, 3 * p, 3 * p * p, p ** 3])
    assert (roots.real.max() < 0.0) == (scale < 1.0)
