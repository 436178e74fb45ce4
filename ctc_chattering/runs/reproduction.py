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
The experiments of the paper on the nodes, over ROS.

`ctc reproduce` calls `record` and draws the bags. `reproduce` does the same for a script.
"""

from __future__ import annotations

from collections.abc import Callable
import os
from pathlib import Path

from ctc_chattering.analysis.result import Result
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.package_share import EXPERIMENTS, find_config
from ctc_chattering.output_folder import new_folder

#: Name in the directory of `reproduce`.
BAGS = 'bags'
#: The command that writes it.
REPRODUCE = 'ctc reproduce'
#: Takes the name of an experiment, its time and its duration [s].
Progress = Callable[[str, float, float], None]


def reproduce(out: str | Path, progress: Progress | None = None, overwrite: bool = False
              ) -> list[Result]:
    """
    Run and record the paper's experiments on the nodes.

    `simulate` gives the same numbers without ROS, and `write_runs` makes figures and a page.

    Parameters
    ----------
    out : str or Path
        Directory for ``bags``, with one of each experiment.
    progress : callable, optional
        Called with the name of an experiment, its time and its duration [s].
    overwrite : bool
        Replace the files of an earlier call.

    Returns
    -------
    list of Result
        Result of each experiment.

    Raises
    ------
    CtcError
        If there are files already, a node dies, or SIGINT or SIGTERM stops the run.
    ModuleNotFoundError
        Without ROS.

    """
    with new_folder(Path(out), REPRODUCE, overwrite) as folder:
        return record(folder / BAGS, progress)


def record(directory: Path, progress: Progress | None = None) -> list[Result]:
    """Record a bag of each experiment."""
    from ctc_chattering.bags.reader import read_bag
    from ctc_chattering.launch.graph import run_graph

    bags = [directory / name for name in EXPERIMENTS]
    # Another graph may run on this host.
    namespace = '--ros-args', '-r', f'__ns:=/reproduction_{os.getpid()}'
    for (file, values), bag in zip(EXPERIMENTS.values(), bags):
        setup = parameter_file.load(find_config(file), {'controller': values})

        def moved(time: float, name: str = bag.name, end: float = setup.plant.duration) -> None:
            if progress is not None:
                progress(name, time, end)
        run_graph(setup, bag, namespace, moved, lambda _: None)
        moved(setup.plant.duration)
    return [read_bag(bag) for bag in bags]
