"""docs/comparison.md says what `make compare` wrote, and what the code declares."""

from __future__ import annotations

import csv
import re

from comparison_page import DOCS, filled, PAGE
from ctc_chattering.studies.conditions import ALL, CONDITIONS
from ctc_chattering.studies.tuning import DIVERGED, Weights
import pytest

TEXT = PAGE.read_text(encoding='utf-8')


def test_its_tables_are_those_that_were_written() -> None:
    assert filled(TEXT) == TEXT
    assert TEXT.count('<!-- tables: ') == 2


def test_it_has_every_condition_and_the_cost() -> None:
    table = TEXT[TEXT.index('| `--condition` |'):].split('\n\n')[0]
    assert re.findall(r'^\| `(\w+)`', table, re.MULTILINE) == [*CONDITIONS, ALL]
    error, variation, rate = Weights()
    assert f'`{error:g} ln(e / e₀) + {variation:g} ln(V / V₀) + {rate:g} ln(R / R₀)`' in TEXT
    assert f'costs {DIVERGED:g}' in TEXT


@pytest.mark.parametrize('directory', ['two_link', 'urdf'])
def test_each_number_of_the_tables_is_in_the_csv(directory: str) -> None:
    """Check the RMS errors, row by row and joint by joint."""
    with (DOCS / 'comparison' / directory / 'compare.csv').open(encoding='utf-8') as stream:
        lines = [x for x in csv.DictReader(stream) if x['rms_error']]
    text = (DOCS / 'comparison' / directory / 'compare.md').read_text(encoding='utf-8')
    title, shown = '', {}
    for line in text.replace('**', '').splitlines():
        title = line.partition(': ')[0] if ': RMS error' in line else (
            '' if ': torque variation' in line else title)
        cells = [x.strip() for x in line.strip('|').split('|')]
        if title and len(cells) > 3:
            shown[(title, cells[0], cells[1], cells[2])] = cells[3:]
    assert lines
    for x in lines:
        title = f'{x["experiment"]}, plant {x["backend"]}, {x["condition"]}'
        joints = [y['joint'] for y in lines if (y['experiment'], y['backend'], y['condition']) == (
            x['experiment'], x['backend'], x['condition']) and y['law'] == 'compensation'
            and y['settings'] == 'file']
        row = shown[title, x['law'], x['switching'], x['settings']]
        assert row[joints.index(x['joint'])] == f'{float(x["rms_error"]):.2e}'
