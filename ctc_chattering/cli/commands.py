"""The subcommands of `ctc`; each imports what it needs when it is called."""

from __future__ import annotations

import argparse
from contextlib import closing
import sys
import time

from ctc_chattering.analysis.export import write_csv, write_npz
from ctc_chattering.analysis.output import prepare
from ctc_chattering.analysis.result import simulated, write_metrics
from ctc_chattering.cli.options import (
    check,
    chosen_engine,
    find_file,
    load_setup,
    number_of_jobs,
)
from ctc_chattering.cli.presentation import (
    FIGURES,
    METRICS,
    PAGE,
    present,
    print_page,
    print_results,
)
from ctc_chattering.cli.progress import Progress, progress_bar
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.node_parameters import parameter_table
from ctc_chattering.errors import CtcError

#: Simulated duration of a run without an end [s].
_DURATION = 10.0
#: Name in an output directory.
_BAGS = 'bags'


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def simulate(options: argparse.Namespace) -> int:
    """Run `ctc simulate`."""
    file, over, setup = load_setup(options)
    if setup.plant.duration == 0.0:
        print(f'duration is 0, no end: simulating {_DURATION:g} s', file=sys.stderr)
        over.setdefault('plant', {})['duration'] = _DURATION
        setup = parameter_file.load(file, over)
    if options.out is not None:
        prepare(options.out, (METRICS, 'trajectory.npz'), options.overwrite)
    with Progress(setup.plant.experiment, setup.plant.duration) as progress:
        result = simulated(setup, progress)
        progress(setup.plant.duration)
    if options.out is not None:
        write_metrics([result], options.out / METRICS)
        write_npz(result, options.out / 'trajectory.npz')
    print_results([result])
    return 0


def reproduce(options: argparse.Namespace) -> int:
    """Run `ctc reproduce`."""
    from ctc_chattering.configuration.paper import EXPERIMENTS
    from ctc_chattering.launch.graph import run_graph
    from ctc_chattering.ros.domain import own_domain

    out = prepare(options.out, (_BAGS, FIGURES, METRICS, PAGE), options.overwrite)
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

    return present([read_bag(bag) for bag in bags], bags, out)


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
    out = prepare(options.out, (FIGURES, METRICS, PAGE), options.overwrite)
    return present(results, bags, out, options.format)


def export(options: argparse.Namespace) -> int:
    """Run `ctc export`."""
    from ctc_chattering.bags.reader import read_bag

    result = read_bag(options.bag)
    name, write = ('trajectory.csv', write_csv) if options.csv else ('trajectory.npz', write_npz)
    out = prepare(options.out, (name,), options.overwrite)
    write(result, out / name)
    print(f'{len(result.run.t)} samples: {out / name}')
    return 0


def study(options: argparse.Namespace) -> int:
    """Run `ctc study`."""
    from ctc_chattering.analysis.engine import compile_loop
    from ctc_chattering.studies import study_files
    from ctc_chattering.studies.cases import CASES
    from ctc_chattering.studies.study import engines, run_cases

    jobs, engine, start = number_of_jobs(options.jobs), chosen_engine(options), time.monotonic()
    kind = study_files.LAWS if options.laws else study_files.SWITCHINGS
    out = prepare(options.out, kind.names, options.overwrite)
    compile_loop((case.setup() for case in CASES), engine, _say)
    outcomes = list(progress_bar(
        run_cases(CASES, kind.variants, jobs, engine), desc=kind.name, unit='run',
        total=len(CASES) * len(kind.variants)))
    print('drawing ...', flush=True)
    page = study_files.write_study(kind, outcomes, out, engine)
    failed = sum(bool(outcome.score.failure) for outcome in outcomes)
    print(f'{len(outcomes)} runs, {failed} diverged, {time.monotonic() - start:.0f} s. '
          f'{engines(outcomes)}.')
    print_page(page)
    return 0


def compare(options: argparse.Namespace) -> int:
    """Run `ctc compare`."""
    from ctc_chattering.analysis.engine import compile_loop
    from ctc_chattering.cli import comparison_options as chosen
    from ctc_chattering.studies import comparison
    from ctc_chattering.studies.comparison_files import NAMES, PAGE, write_comparison
    from ctc_chattering.studies.comparison_tables import to_markdown
    from ctc_chattering.studies.score import Runner, Simulation

    engine = chosen.engine(options)
    run: Runner = Simulation(engine)
    if options.ros:
        from ctc_chattering.studies.over_ros import over_ros as run
    todo = comparison.tasks(
        [find_file(file) for file in options.files], chosen.backends(options),
        chosen.conditions(options), chosen.laws(options), chosen.budget(options))
    if options.out is not None:
        prepare(options.out, NAMES, options.overwrite)
    jobs = 1 if options.ros else number_of_jobs(options.jobs)
    runs = comparison.compare(todo, jobs, run)
    if not options.ros:
        compile_loop(comparison.setups(todo), engine, _say)
    outcomes = list(progress_bar(runs, desc='compare', unit='law', total=len(todo)))
    print(to_markdown(outcomes))
    if options.out is not None:
        write_comparison(outcomes, options.out)
        print_page(options.out / PAGE)
    return 0


def replay(options: argparse.Namespace) -> int:
    """Run `ctc replay`."""
    check('--rate', options.rate, 0, exclusive=True)
    check('--delay', options.delay, 0)
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
    from ctc_chattering.cli.model_check import run
    return run(options)


def excite(options: argparse.Namespace) -> int:
    """Run `ctc excite`."""
    from ctc_chattering.cli.excitation import run
    return run(options)


def map(options: argparse.Namespace) -> int:  # noqa: A001
    """Run `ctc map`."""
    from ctc_chattering.cli.map import run
    return run(options)


def tune(options: argparse.Namespace) -> int:
    """Run `ctc tune`."""
    from ctc_chattering.cli.tune import run
    return run(options)


def parameters(_options: argparse.Namespace) -> int:
    """Run `ctc parameters`."""
    print(parameter_table())
    return 0
