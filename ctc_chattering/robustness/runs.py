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

"""The runs of a map in their order: point of the grid, then law, then repeat."""

from __future__ import annotations

from typing import Any, NamedTuple

from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.errors import CtcError
from ctc_chattering.robustness.quantity import applied, Quantity
from ctc_chattering.robustness.sampling import draws
from ctc_chattering.robustness.spec import MapSpec
from ctc_chattering.studies.recommended import recommended_setup
import numpy as np


class RunPlace(NamedTuple):
    """
    Where a run is in its map.

    Attributes
    ----------
    point : int
        Index in the grid, the last axis fastest.
    indices : tuple of int
        Index in the values of each axis.
    variant, repeat : int
        Indices of the law and of the draw.

    """

    point: int
    indices: tuple[int, ...]
    variant: int
    repeat: int


class Runs:
    """
    Numbers, columns and setups of the runs of a map.

    A parameter is that of the file, then of the law, then of the axes, then of the draw. What is
    recommended for a law is so for the values of the axes that the controller knows.

    Parameters
    ----------
    spec : MapSpec
        The map.

    Attributes
    ----------
    spec : MapSpec
        The same.
    draws : ndarray, shape (repeats, m)
        Number of each uncertain quantity in each repeat.

    """

    def __init__(self, spec: MapSpec) -> None:
        self.spec = spec
        self.draws = draws(spec.uncertain, spec.repeats)
        #: Setup of each law at the values of the known axes for which it was needed last.
        self._of_laws: dict[int, tuple[tuple[float, ...], Setup]] = {}

    def __len__(self) -> int:
        """Return the number of runs."""
        return self.spec.runs

    def place(self, run: int) -> RunPlace:
        """Return where a run is."""
        rest, repeat = divmod(run, self.spec.repeats.repeats)
        point, variant = divmod(rest, len(self.spec.variants))
        indices = np.unravel_index(point, self.spec.shape) if self.spec.axes else ()
        return RunPlace(point, tuple(map(int, indices)), variant, repeat)

    def number(self, indices: tuple[int, ...], variant: int, repeat: int) -> int:
        """Return the number of the run at a place."""
        point = int(np.ravel_multi_index(indices, self.spec.shape)) if indices else 0
        return (point * len(self.spec.variants) + variant) * self.spec.repeats.repeats + repeat

    def columns(self, run: int) -> dict[str, Any]:
        """Return which run it is, as its row of the results says."""
        place, spec = self.place(run), self.spec
        variant = spec.variants[place.variant]
        return {'run': run, 'point': place.point, 'repeat': place.repeat,
                'seed': self._seed(place.repeat), 'variant': variant.name,
                'law': variant.law, 'switching': variant.switching,
                **{quantity.name: x for quantity, x in self._settings(place)}}

    def setup(self, run: int) -> Setup:
        """
        Return what is run.

        Raises
        ------
        CtcError
            If values of axes or draws contradict each other, or a draw is not allowed.

        """
        place = self.place(run)
        settings = self._settings(place)
        known = tuple(x for quantity, x in settings[:len(self.spec.axes)] if quantity.known)
        return applied(self._of_law(place.variant, known), settings, self._seed(place.repeat))

    def _seed(self, repeat: int) -> int:
        """Return the seed of the noise; the same for all repeats if differences count."""
        repeats = self.spec.repeats
        return repeats.seed + (0 if repeats.sampling == 'saltelli' else repeat)

    def example(self, variant: int) -> Setup:
        """Return a setup of a law: that of the first point without a draw, if it is allowed."""
        axes = [(axis, axis.values[0]) for axis in self.spec.axes]
        setup = self._of_law(variant, tuple(x for axis, x in axes if axis.known))
        try:
            return applied(setup, axes)
        except CtcError:
            return setup

    def _settings(self, place: RunPlace) -> list[tuple[Quantity, float]]:
        """Return the numbers of all quantities at a place, in the order in which they are set."""
        axes = [(axis, axis.values[i]) for axis, i in zip(self.spec.axes, place.indices)]
        return [*axes, *zip(self.spec.uncertain, self.draws[place.repeat].tolist())]

    def _of_law(self, index: int, known: tuple[float, ...]) -> Setup:
        """Return the setup of a law at the values of the axes that the controller knows."""
        variant = self.spec.variants[index]
        last, setup = self._of_laws.get(index, (None, self.spec.setup))
        if last is None or (variant.recommended and last != known):
            recommended = self._recommended(variant.law, known) if variant.recommended else {}
            setup = self.spec.setup.changed(recommended).changed({'controller': variant.values})
            self._of_laws[index] = known, setup
        return setup

    def _recommended(self, law: str, known: tuple[float, ...]) -> dict[str, dict[str, Any]]:
        """Return what is recommended for a law, by node, but for what a known axis sets."""
        file, axes = self.spec.setup, [axis for axis in self.spec.axes if axis.known]
        made = recommended_setup(applied(file, zip(axes, known)), law)
        by_axes = {(node, spec.name) for axis in axes for node, spec in axis.targets}
        values: dict[str, dict[str, Any]] = {}
        for node, new, old in (('controller', made.controller, file.controller),
                               ('reference', made.reference, file.reference)):
            before = old.as_mapping()
            values[node] = {name: x for name, x in new.as_mapping().items()
                            if x != before[name] and (node, name) not in by_axes}
        return values
