"""`ctc identify`: from a bag to all of its files, and one line for what is wrong."""

from __future__ import annotations

import json
from pathlib import Path

from ctc_chattering.cli.ctc import main
from ctc_chattering.configuration import parameter_file
from identified_bags import recorded_bag, short
import numpy as np
import pytest


def test_a_bag_becomes_numbers_gains_figures_and_a_page(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = short()
    bag = recorded_bag(tmp_path / 'run', made, order=(1, 0), extra=('finger',))
    out = tmp_path / 'out'
    command = ['identify', str(bag), '--validate', str(bag), '--model', 'two_link',
               '--torque-rate', '5000,1000', '--trials', '0', '--out', str(out)]
    assert main(command) == 0
    text = capsys.readouterr().out
    for words in ('Friction', 'delay of the torque: 0 samples', 'Validation on run',
                  'holds: joint1', 'ka = [', 'too fast'):
        assert words in text
    found = json.loads((out / 'identify.json').read_text())
    for friction, true in zip(found['friction'], made.plant.coulomb_friction):
        low, high = friction['coulomb']['interval_95']
        assert low < friction['coulomb']['value'] < high
        assert friction['coulomb']['value'] == pytest.approx(true, rel=0.02)
    setup = parameter_file.load(out / 'identified.yaml')
    assert setup.plant.coulomb_friction == pytest.approx(made.plant.coulomb_friction, rel=0.02)
    page = (out / 'index.html').read_text()
    assert 'Friction and gains from run' in page
    for figure in ('friction', 'perturbation', 'residual', 'spectrum', 'validation'):
        assert f'figures/{figure}.svg' in page
        assert (out / 'figures' / f'{figure}.svg').is_file()
    assert main(command) == 1
    assert 'exists already' in capsys.readouterr().err


def test_errors_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = short(duration=1.0)
    bag = str(recorded_bag(tmp_path / 'run', made))

    def said(*arguments: str) -> str:
        assert main(['identify', *arguments, '--out', str(tmp_path / 'out')]) != 0
        text = capsys.readouterr().err
        assert text.count('\n') == 1
        return text
    assert 'no such bag' in said(str(tmp_path / 'nothing'))
    assert 'no robot description: give --urdf FILE, or --model' in said(bag)
    assert '--torque-rate: -1' in said(bag, '--model', 'two_link', '--torque-rate', '-1')
    assert 'without a gap; at least 2 s' in said(bag, '--model', 'two_link')
    still = recorded_bag(tmp_path / 'still', made, q=np.zeros_like(made.run.q))
    assert 'at least 2 s' in said(str(still), '--model', 'two_link')
