"""Options of `ctc compare`."""

from __future__ import annotations

import argparse
from math import inf, nan
from typing import TYPE_CHECKING

from ctc_chattering.cli.options import add_engine_option, chosen_engine
from ctc_chattering.control.controller import LAWS
from ctc_chattering.errors import given_by_user, near, UsageError
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.studies.conditions import ALL, CONDITIONS

if TYPE_CHECKING:
    from ctc_chattering.studies.tuning import Budget


def add_comparison_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc compare`."""
    parser.add_argument('files', nargs='+', metavar='F',
                        help='parameter file, or the name of one of the package, such as panda')
    parser.add_argument('--backend', action='append', metavar='X',
                        help="plant in place of the file's: builtin | mujoco; may be repeated")
    parser.add_argument('--condition', action='append', metavar='X',
                        help='drives, sensors and model error in place of those of the file: '
                             f'{" | ".join((*CONDITIONS, ALL))}; may be repeated')
    parser.add_argument('--laws', metavar='A,B', default=','.join(LAWS),
                        help='laws to run, all by default')
    parser.add_argument('--trials', type=int, metavar='N',
                        help="tune every law, with N trials each; without it, the file's gains")
    parser.add_argument('--seed', type=int, default=0, metavar='S',
                        help='seed of the trials, 0 by default')
    parser.add_argument('--weights', default='1,0.5,0.25', metavar='E,V,R',
                        help='weights of RMS error, torque variation and largest torque rate in '
                             'the cost that is tuned for, 1,0.5,0.25 by default')
    parser.add_argument('--jobs', type=int, metavar='N',
                        help='processes, as many as there are processors by default')
    parser.add_argument('--ros', action='store_true',
                        help='run the nodes and evaluate the bags, not the simulation')
    add_engine_option(parser)


def backends(options: argparse.Namespace) -> list[str | None]:
    """Return the backends, None for the file's; raise `UsageError`."""
    for name in options.backend or ():
        with given_by_user(['plant_backend']):
            PlantConfig.parameters()['plant_backend'].check(name, 0)
    return options.backend or [None]


def conditions(options: argparse.Namespace) -> list[str | None]:
    """Return the names of the conditions; None for the robot as it is in the file."""
    return options.condition or [None]


def laws(options: argparse.Namespace) -> list[str]:
    """Return the laws, or raise `UsageError`."""
    names: list[str] = options.laws.split(',')
    for law in names:
        if law not in LAWS:
            raise UsageError(f'--laws: no law is called {law}; allowed: {", ".join(LAWS)}'
                             + near(law, LAWS))
    return names


def engine(options: argparse.Namespace) -> str | None:
    """Return what simulates, as `chosen_engine`; raise `UsageError` if nothing does."""
    if options.engine and options.ros:
        raise UsageError('--engine and --ros exclude each other: the nodes run, no simulation')
    return chosen_engine(options)


def budget(options: argparse.Namespace) -> Budget | None:
    """Return trials, seed and weights, or None without trials; raise `UsageError`."""
    from ctc_chattering.studies.search import require_optuna
    from ctc_chattering.studies.tuning import Budget, Weights

    try:
        weights = Weights(*map(float, options.weights.split(',')))
    except (TypeError, ValueError):
        weights = Weights(nan)
    if not all(0.0 <= x < inf for x in weights):
        raise UsageError(f'--weights: {options.weights}; allowed: up to three numbers >= 0')
    if options.trials is None:
        return None
    if options.trials < 1 or not 0 <= options.seed < 2 ** 32:
        raise UsageError('allowed: --trials from 1 on, --seed from 0 to 2**32 - 1')
    if options.ros:
        raise UsageError('--trials and --ros exclude each other: the simulation is tuned')
    require_optuna('--trials')
    return Budget(options.trials, options.seed, weights)
