"""The subcommands of `ctc`; each imports what it needs when it is called."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import closing
import os
from pathlib import Path
import sys
import time
from typing import Any

from ctc_chattering.analysis.export import write_csv, write_npz
from ctc_chattering.analysis.output import prepare, write_text
from ctc_chattering.analysis.result import Result, simulated, write_metrics
from ctc_chattering.analysis.run_names import names
from ctc_chattering.cli.options import find_file, overrides
from ctc_chattering.cli.progress import Progress, progress_bar
from ctc_chattering.cli.table import print_columns
from ctc_chattering.control.controller import LAWS
from ctc_chattering.control.switching import SWITCHINGS
from ctc_chattering.errors import CtcError
from ctc_chattering.experiment import parameter_file
from ctc_chattering.experiment.node_parameters import parameter_table
from ctc_chattering.experiment.robot_description import read_description
from ctc_chattering.parameters import check_joint_names, Parameter

#: Simulated duration of a run without an end [s].
_DURATION = 10.0
#: Names in an output directory.
_FIGURES, _METRICS, _PAGE, _BAGS = 'figures', 'metrics.json', 'index.html', 'bags'


def simulate(options: argparse.Namespace) -> int:
    """Run `ctc simulate`."""
    file, over = find_file(options.params_file), overrides(options)
    setup = parameter_file.load(file, over)
    if setup.plant.duration == 0.0:
        print(f'duration is 0, no end: simulating {_DURATION:g} s', file=sys.stderr)
        over.setdefault('plant', {})['duration'] = _DURATION
        setup = parameter_file.load(file, over)
    if options.out is not None:
        prepare(options.out, (_METRICS, 'trajectory.npz'), options.overwrite)
    with Progress(setup.plant.experiment, setup.plant.duration) as progress:
        result = simulated(setup, progress)
        progress(setup.plant.duration)
    if options.out is not None:
        write_metrics([result], options.out / _METRICS)
        write_npz(result, options.out / 'trajectory.npz')
    _print_table([result])
    return 0


def reproduce(options: argparse.Namespace) -> int:
    """Run `ctc reproduce`."""
    from ctc_chattering.experiment.paper import EXPERIMENTS
    from ctc_chattering.launch.graph import run_graph
    from ctc_chattering.ros.domain import own_domain

    out = prepare(options.out, (_BAGS, _FIGURES, _METRICS, _PAGE), options.overwrite)
    bags = []
    width = max(len(experiment.name) for experiment in EXPERIMENTS)
    with own_domain():
        for experiment in EXPERIMENTS:
            duration = parameter_file.load(experiment.path, experiment.overrides).plant.duration
            bags.append(out / _BAGS / experiment.name)
            with Progress(f'{experiment.name:{width}}', duration) as progress:
                run_graph(experiment.path, experiment.overrides, bags[-1], progress=progress,
                          show=lambda _: None)
                progress(duration)
    from ctc_chattering.bags.reader import read_bag

    return _present([read_bag(bag) for bag in bags], bags, out)


def plot(options: argparse.Namespace) -> int:
    """Run `ctc plot`."""
    from ctc_chattering.bags.reader import find_bags, read_bag

    bags, results = [], []
    for path in options.bags:
        found = find_bags(path)
        for bag in found or [path]:
            try:
                results.append(read_bag(bag))
                bags.append(bag)
            except CtcError as error:
                if not found:
                    raise
                print(f'left out: {error}', file=sys.stderr)
    if not results:
        raise CtcError('no bag of this package in '
                       + ', '.join(str(path) for path in options.bags))
    out = prepare(options.out, (_FIGURES, _METRICS, _PAGE), options.overwrite)
    return _present(results, bags, out, options.format)


def export(options: argparse.Namespace) -> int:
    """Run `ctc export`."""
    from ctc_chattering.bags.reader import read_bag

    result = read_bag(options.bag)
    name, write = ('trajectory.csv', write_csv) if options.csv else ('trajectory.npz', write_npz)
    out = prepare(options.out, (name,), options.overwrite)
    write(result, out / name)
    print(f'{len(result.run.t)} samples: {out / name}')
    return 0


def _present(results: Sequence[Result], bags: Sequence[Path], out: Path,
             extra: str = 'svg') -> int:
    """Write figures, metrics and page into `out`; the figures as `extra` as well."""
    from ctc_chattering.analysis.figures import save_figures
    from ctc_chattering.analysis.report import write_page

    print(f'drawing {len(results)} run{"s" if len(results) > 1 else ""} ...', flush=True)
    figures = save_figures(results, out / _FIGURES, extra)
    write_metrics(results, out / _METRICS)
    write_page(results, figures, out / _PAGE, [os.path.relpath(bag, out) for bag in bags])
    _print_table(results)
    print(f'{len(figures)} figures: open {out / _PAGE}')
    return 0


def study(options: argparse.Namespace) -> int:
    """Run `ctc study`."""
    from ctc_chattering.studies import law_study
    from ctc_chattering.studies import study as switching_study
    from ctc_chattering.studies.cases import CASES
    from ctc_chattering.studies.study_figures import save_study_figures

    jobs, start = _jobs(options.jobs), time.monotonic()
    variants: Sequence[str] = LAWS if options.laws else SWITCHINGS
    if options.laws:
        out = prepare(options.out, ('laws.md', 'laws.csv'), options.overwrite)
        page, runs = out / 'laws.md', law_study.run_laws(CASES, jobs=jobs)
    else:
        out = prepare(options.out, (_FIGURES, 'study.md', 'study.csv'), options.overwrite)
        page, runs = out / 'study.md', switching_study.run_cases(CASES, SWITCHINGS, jobs)
    outcomes = list(progress_bar(runs, desc=page.stem, unit='run',
                                 total=len(CASES) * len(variants)))
    write_text(page.with_suffix('.csv'),
               switching_study.to_csv(outcomes, 'law' if options.laws else 'switching'))
    if options.laws:
        text = law_study.to_markdown(outcomes)
    else:
        print('drawing ...', flush=True)
        text = switching_study.to_markdown(outcomes) + '\n## Figures\n' + ''.join(
            f'\n![{figure.caption}]({figure.path.relative_to(out)})\n'
            for figure in save_study_figures(outcomes, out / _FIGURES))
    write_text(page, text)
    failed = sum(bool(outcome.failure) for outcome in outcomes)
    print(f'{len(outcomes)} runs, {failed} diverged, {time.monotonic() - start:.0f} s: '
          f'open {page}')
    return 0


def compare(options: argparse.Namespace) -> int:
    """Run `ctc compare`."""
    from ctc_chattering.cli import comparison_options as chosen
    from ctc_chattering.studies import comparison
    from ctc_chattering.studies.comparison_files import NAMES, write_comparison
    from ctc_chattering.studies.comparison_tables import to_markdown
    from ctc_chattering.studies.measurement import over_ros, over_simulation

    todo = comparison.tasks(
        [find_file(file) for file in options.files], options.backend or [None],
        chosen.conditions(options), chosen.laws(options), chosen.budget(options))
    if options.out is not None:
        prepare(options.out, NAMES, options.overwrite)
    jobs = 1 if options.ros else _jobs(options.jobs)
    outcomes = list(progress_bar(
        comparison.compare(todo, jobs, over_ros if options.ros else over_simulation),
        desc='compare', unit='law', total=len(todo)))
    print(to_markdown(outcomes))
    if options.out is not None:
        write_comparison(outcomes, options.out)
    return 0


def _jobs(number: int | None) -> int:
    """Return the number of processes; all processors by default."""
    jobs = (os.cpu_count() or 1) if number is None else number
    _check('--jobs', jobs, 1)
    return jobs


def replay(options: argparse.Namespace) -> int:
    """Run `ctc replay`."""
    _check('--rate', options.rate, 0, exclusive=True)
    _check('--delay', options.delay, 0)
    from ctc_chattering.bags.repair import open_bag
    with closing(open_bag(options.bag)) as reader:
        from ctc_chattering.bags.replay import play
        count = play(reader, options.rate, options.delay)
    print(f'{count} messages')
    return 0


def repair(options: argparse.Namespace) -> int:
    """Run `ctc repair`."""
    from ctc_chattering.bags.repair import repair as repair_bag
    done = repair_bag(options.bag)
    if done is None:
        print(f'{options.bag}: nothing to repair')
    else:
        print(f'{options.bag}: {done[0]}; the damaged bag is now {done[1]}')
    return 0


def identify(options: argparse.Namespace) -> int:
    """Run `ctc identify`."""
    from ctc_chattering.cli.identify import identify as run
    return run(options)


def check_model(options: argparse.Namespace) -> int:
    """Run `ctc check-model`."""
    from ctc_chattering.dynamics.inertia_check import inertia_faults
    from ctc_chattering.dynamics.model_check import check_dynamics
    from ctc_chattering.dynamics.registry import make_model

    _check('--samples', options.samples, 1)
    _check('--seed', options.seed, 0)
    _check('--gravity', options.gravity, 0)
    name = options.model or ('urdf' if options.urdf else 'two_link')
    if (name == 'urdf') != (options.urdf is not None):
        raise CtcError(f'the model {name} {"needs" if name == "urdf" else "takes no"} --urdf FILE')
    urdf = read_description(options.urdf) if options.urdf else ''
    joints = _joints(options.joints, urdf)
    model = make_model(name, options.gravity, joints, urdf)
    print(f'{name}, {model.n} joints: {", ".join(joints)}')
    findings = check_dynamics(model, options.seed, options.samples)
    print_columns([('', 'worst', 'allowed', 'check')] + [
        ('ok' if x.passed else 'FAILED', f'{x.worst:.2g}', f'{x.tolerance:.2g}', x.name)
        for x in findings])
    failed = [x for x in findings if not x.passed]
    for x in failed:
        print(f'{x.name}: worst at q = {_numbers(list(x.q))}, dq = {_numbers(list(x.dq))}'
              + (f': {x.error}' if x.error else ''))
    for fault in inertia_faults(urdf, joints) if urdf else ():
        print(f'warning: {fault}')
    return 1 if failed else 0


def excite(options: argparse.Namespace) -> int:
    """Run `ctc excite`."""
    from ctc_chattering.cli.excitation import run
    return run(options)


def _joints(option: str | None, urdf: str) -> tuple[str, ...]:
    """Return the joints that the option names, by default all of the robot that can move."""
    from ctc_chattering.dynamics.urdf_parser import Tree

    joints: tuple[str, ...] = ('joint1', 'joint2')
    if option is not None:
        joints = tuple(x.strip() for x in option.split(','))
    elif urdf:
        joints = Tree(urdf).movable
        if not joints:
            raise CtcError('the description has no joint that moves')
    check_joint_names(joints)
    return joints


def parameters(_options: argparse.Namespace) -> int:
    """Run `ctc parameters`."""
    print(parameter_table())
    return 0


def _check(option: str, value: float, minimum: float, exclusive: bool = False) -> None:
    """Raise `ParameterError` unless the value of an option is finite and large enough."""
    Parameter(option, type(value).__name__, None, '', minimum=minimum,
              exclusive=exclusive).check(value, 0)


def _print_table(results: Sequence[Result]) -> None:
    """Print the runs' numbers in a table."""
    rows: list[Sequence[str]] = [(
        'run', 'RMS e [rad]', 'max |e|_1 [rad]', 'torque variation [N*m/s]', 'v reached [s]')]
    notes = []
    for name, result in zip(names(results), results):
        m = result.metrics()
        rows.append((name, *(_numbers(m[key]) for key in (
            'rms_error_rad', 'max_error_norm1_rad', 'torque_variation_nm_per_s',
            'reaching_time_s'))))
        notes += [f'{name}: {text}' for text in m['notes']]
    print_columns(rows)
    if notes:
        print('\n'.join(notes))


def _numbers(value: Any) -> str:
    if value is None:
        return '-'
    items = value if isinstance(value, list) else [value]
    return ' '.join(f'{x:.3g}' if abs(x) < 100.0 else f'{x:.0f}' for x in items)
