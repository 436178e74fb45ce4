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

"""MuJoCo and Drake with the arm of a parameter file, at 1 kHz, as fast as each of them can."""

from __future__ import annotations

from importlib import import_module
from math import pi
from typing import Any, NamedTuple
import xml.etree.ElementTree as ElementTree

from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.simulation.closed_loop import Run
import numpy as np

#: Step [s].
_PERIOD = 1e-3


class Rollout:
    """
    The torques of a run, replayed by `mujoco.rollout`: no law, no Python in the loop.

    Parameters
    ----------
    setup : Setup
        With a description; friction is as hard as the tests have it of MuJoCo.
    run : Run
        Of that setup.

    """

    def __init__(self, setup: Setup, run: Run) -> None:
        from mujoco_plant import MujocoPlant  # MuJoCo may be missing.

        self._mujoco, self._rollout = import_module('mujoco'), import_module('mujoco.rollout')
        limit = np.array(setup.plant.torque_saturation)
        plant = MujocoPlant(setup.plant, setup.descriptions['plant'])
        self._model, self._data = plant.mjmodel, plant.mjdata
        self._order = [self._model.joint(name).id for name in setup.plant.joint_names]
        # The plant sets it in each step.
        self._model.dof_frictionloss[self._order] = setup.plant.coulomb_friction
        self._torques = np.zeros((1, len(run.t) - 1, len(limit)))
        self._torques[0][:, self._order] = np.clip(run.tau[:-1], -limit, limit)
        what = self._mujoco.mjtState.mjSTATE_FULLPHYSICS
        self._start = np.zeros(self._mujoco.mj_stateSize(self._model, what))
        self._mujoco.mj_getState(self._model, self._data, self._start, what)

    def positions(self) -> Array:
        """Return the positions at the samples after the first, shape (N - 1, n) [rad]."""
        states, _ = self._rollout.rollout(
            self._model, self._data, self._start, self._torques,
            control_spec=self._mujoco.mjtState.mjSTATE_QFRC_APPLIED)
        found: Array = states[0, :, 1:][:, self._order]  # The first column is the time.
        return found


class DrakeLoop:
    """
    Drake's discrete plant and its computed torque, joined in C++, without friction.

    Parameters
    ----------
    setup : Setup
        With a description. Friction, limits, the smooth start and the filter are left out.

    Raises
    ------
    ImportError
        If Drake is not there.

    """

    def __init__(self, setup: Setup) -> None:
        self._drake = drake = import_module('pydrake.all')
        import_module('logging').getLogger('drake').setLevel('ERROR')  # Of unused elements.
        self._setup, n = setup, len(setup.plant.joint_names)
        builder = drake.DiagramBuilder()
        self._plant, self._model = builder.AddSystem(self._arm()), self._arm()
        law = builder.AddSystem(drake.InverseDynamicsController(
            self._model, np.array(setup.controller.kp), np.zeros(n),
            np.array(setup.controller.kv), True))
        wanted = _desired(drake, builder, setup)
        builder.Connect(wanted.state, law.get_input_port_desired_state())
        builder.Connect(wanted.acceleration, law.get_input_port_desired_acceleration())
        builder.Connect(self._plant.get_state_output_port(), law.get_input_port_estimated_state())
        builder.Connect(law.get_output_port_control(), self._plant.get_actuation_input_port())
        self._log = builder.AddSystem(drake.VectorLogSink(2 * n, _PERIOD))
        builder.Connect(self._plant.get_state_output_port(), self._log.get_input_port())
        self._simulator = drake.Simulator(builder.Build())

    def _arm(self) -> Any:
        """Return the arm with an actuator on every joint."""
        names, drake = self._setup.plant.joint_names, self._drake
        root = ElementTree.fromstring(self._setup.descriptions['plant'])
        _reduce(root, names)
        plant = drake.MultibodyPlant(_PERIOD)
        plant.SetUseSampledOutputPorts(False)  # A tenth faster.
        drake.Parser(plant).AddModelsFromString(
            ElementTree.tostring(root, encoding='unicode'), 'urdf')
        base = root.find('link')
        assert base is not None
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(base.get('name')))
        for name in names:
            joint = plant.GetJointByName(name)
            joint.set_default_damping(0.0)
            plant.AddJointActuator(name, joint)
        plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -self._setup.plant.gravity])
        plant.Finalize()
        return plant

    def positions(self) -> Array:
        """Return the positions at the samples, shape (N, n) [rad]."""
        config, context = self._setup.plant, self._simulator.get_mutable_context()
        context.SetTime(0.0)
        inner = self._plant.GetMyMutableContextFromRoot(context)
        self._plant.SetPositions(inner, np.array(config.initial_position))
        self._plant.SetVelocities(inner, np.array(config.initial_velocity))
        self._log.FindMutableLog(context).Clear()
        self._simulator.Initialize()
        self._simulator.AdvanceTo(config.duration)
        found: Array = self._log.FindLog(context).data().T[:, :len(config.joint_names)]
        return found


class _Ports(NamedTuple):
    """Desired position and velocity, and desired acceleration."""

    state: Any
    acceleration: Any


def _desired(drake: Any, builder: Any, setup: Setup) -> _Ports:
    """Add the sinusoid of a setup, and return its ports."""
    reference = setup.reference
    n = len(reference.center)
    sine = builder.AddSystem(drake.Sine(
        np.array(reference.amplitude), 2.0 * pi * np.array(reference.frequency),
        np.array(reference.phase), True))
    center = builder.AddSystem(drake.ConstantVectorSource(np.array(reference.center)))
    position = builder.AddSystem(drake.Adder(2, n))
    state = builder.AddSystem(drake.Multiplexer([n, n]))
    builder.Connect(sine.get_output_port(0), position.get_input_port(0))
    builder.Connect(center.get_output_port(), position.get_input_port(1))
    builder.Connect(position.get_output_port(), state.get_input_port(0))
    builder.Connect(sine.get_output_port(1), state.get_input_port(1))
    return _Ports(state.get_output_port(), sine.get_output_port(2))


def _reduce(root: ElementTree.Element, names: tuple[str, ...]) -> None:
    """Fix the joints of a URDF that are not in `names`, and remove its shapes."""
    for joint in root.iter('joint'):
        if joint.get('type') and joint.get('name') not in names:
            joint.set('type', 'fixed')
    for parent in root.iter():
        for tag in ('visual', 'collision', 'mimic', 'transmission'):
            for child in parent.findall(tag):
                parent.remove(child)
