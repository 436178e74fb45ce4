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
Parameters set while the loop runs: all or nothing, and nothing that is sent ends a node.

Which values are allowed is proved without ROS, in `test_parameters.py`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import math
from pathlib import Path
from typing import Any

from ctc_chattering.configuration.node_parameters import NODES
from faults import Diagnostics
from processes import Probe, probe
import pytest
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue, SetParametersResult
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter as RosParameter
from rclpy.parameter import parameter_value_to_python
from ros_messages import COMMANDS, ns
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

pytestmark = pytest.mark.ros
EXAMPLES = Path(__file__).resolve().parents[2] / 'examples'
NAN, INF = math.nan, math.inf
#: A set of several parameters that is allowed, by node.
VALID: dict[str, dict[str, Any]] = {
    'plant': {'coulomb_friction': [1.0, 2.0], 'command_timeout': 0.5, 'fault_damping': [3.0, 4.0],
              'use_sim_time': True},
    'controller': {'kp': [90.0, 80.0], 'law': 'compensation', 'lambda': 7.0,
                   'anti_windup': False, 'state_decimation': 20, 'use_sim_time': True},
    'reference': {'use_sim_time': True}, 'recorder': {'use_sim_time': True}}
#: What is not, each for another reason; None is for a value that is not set.
WRONG: dict[str, list[tuple[str, Any]]] = {
    'plant': [('viscous_friction', [NAN, 0.0]), ('gravity', 1.0), ('', 1.0),
              ('stribeck_velocity', [0.1] * 3), ('coulomb_friction', None)],
    'controller': [('kv', [1.0, 2.0, 3.0, 1.0]), ('switching', 'magic'), ('model', 'two_link'),
                   ('kp', None), ('unknown', 1), ('law', 'trap:Law'), ('switching', 'trap:Law'),
                   ('law', 'os:system'), ('kp', [100.0, 1.1e7])],
    'reference': [('amplitude', [NAN, 0.0]), ('horizon', 1.0), ('use_sim_time', 'yes')],
    'recorder': [('bag', 'other'), ('unknown', True), ('use_sim_time', None)]}
#: Values of no type, of a type that does not exist, and of some types.
ODD = [
    *(ParameterValue(type=kind) for kind in (
        ParameterType.PARAMETER_NOT_SET, ParameterType.PARAMETER_BYTE_ARRAY,
        ParameterType.PARAMETER_STRING_ARRAY, 77)),
    ParameterValue(type=ParameterType.PARAMETER_INTEGER, integer_value=-2 ** 63),
    *(ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=x) for x in (NAN, 1e308)),
    *(ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=x)
      for x in ('\0', '\u00fc' * 5000)),
    *(ParameterValue(type=ParameterType.PARAMETER_DOUBLE_ARRAY, double_array_value=x)
      for x in ([INF, 1.0], [1.0] * 3000))]
#: Names that no node has.
NO_NAMES = ('', 'kp.x', ' kp', 'KP', '\u03bb', 'bag' * 100, 'qos_overrides./x')
#: A law that cannot be made with every gain, and a module that says that it was imported.
OWN = """
from typing import NamedTuple
from ctc_chattering import law
from own_law import LeakyIntegral
@law()
class Law(NamedTuple):
    own: LeakyIntegral
    @classmethod
    def from_config(cls, config, period):
        if config.ki[0] > 500.0:
            raise ValueError('too much')
        return cls(LeakyIntegral.from_config(config, period))
    def initial(self):
        return self.own.initial()
    def terms(self, memory, at):
        return self.own.terms(memory, at)
"""
TRAP = "from pathlib import Path; Path(__file__).with_name('imported').touch()"


class Setter:
    """The parameter services of a node."""

    def __init__(self, it: Probe, node: str) -> None:
        self.probe, self.node = it, node
        self.names = [*NODES[node].parameters(), 'use_sim_time']

    def set(self, kind: Any, parameters: Sequence[Parameter]) -> Any:  # noqa: A003
        name = {SetParameters: 'set_parameters',
                SetParametersAtomically: 'set_parameters_atomically'}[kind]
        return self.probe.call(kind, f'/{self.node}/{name}', kind.Request(parameters=parameters))

    def all_or_nothing(self, values: Iterable[tuple[str, Any]]) -> SetParametersResult:
        return self.set(SetParametersAtomically, [message(*x) for x in values]).result

    def values(self) -> dict[str, Any]:
        """Return all parameters; each must be there."""
        answer = self.probe.call(GetParameters, f'/{self.node}/get_parameters',
                                 GetParameters.Request(names=self.names))
        found = [parameter_value_to_python(value) for value in answer.values]
        return {name: x if isinstance(x, str) or not hasattr(x, '__len__') else list(x)
                for name, x in zip(self.names, found, strict=True)}


def message(name: str, value: Any) -> Parameter:
    if value is None:
        return Parameter(name=name)
    return RosParameter(name, value=value).to_parameter_msg()


def assert_moving(it: Probe) -> None:
    """Wait for torques and the states that answer them; no node may have ended or raised."""
    torques: list[Float64MultiArray] = []
    states: list[JointState] = []
    # Not for longer than needed: hearing thousands of messages a second, we would be slow.
    ears = [it.node.create_subscription(JointState, 'joint_states', states.append, 10),
            it.node.create_subscription(Float64MultiArray, COMMANDS, torques.append, 10)]
    it.until(lambda: len(torques) > 100 and len(
        {ns(m.header.stamp) for m in states}) > 100, 'motion')
    for ear in ears:
        it.node.destroy_subscription(ear)
    assert {child.status for child in it.children} == {None}
    assert not any('Traceback' in line for line in it.lines)


def assert_a_law_brings_its_gains(setter: Setter) -> None:
    """Check that a law that is set without gains takes its own; with them, in any order, those."""
    before, observer = setter.values(), ('law', 'observer_feedback')
    assert setter.all_or_nothing([observer]).successful
    assert setter.values()['kp'] == [1e4, 1e4]
    assert not setter.all_or_nothing([('law', 'magic')]).successful
    for kind in (SetParameters, SetParametersAtomically):
        assert setter.all_or_nothing([('law', before['law'])]).successful
        assert setter.values() == before
        setter.set(kind, [message('ka', [60.0, 30.0]), message(*observer)])
        assert setter.values() == {**before, 'ka': [60.0, 30.0], 'law': 'observer_feedback'}
    assert setter.all_or_nothing([('law', before['law'])]).successful
    assert setter.values() == before


def test_a_set_is_all_or_nothing_and_nothing_that_is_sent_ends_a_node(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """
    What is refused leaves the loop as it was, and imports nothing.

    A class of one's own is named at the start, and a law must be one that can be made.
    """
    (tmp_path / 'picky.py').write_text(OWN)
    (tmp_path / 'trap.py').write_text(TRAP)
    monkeypatch.setenv('PYTHONPATH', f'{tmp_path}:{EXAMPLES}')
    monkeypatch.chdir(tmp_path)
    arguments = {'plant': 'pacing:=lockstep', 'controller': 'law:=picky:Law',
                 'reference': 'horizon:=0.5', 'recorder': f'bag:={tmp_path / "bag"}'}
    with probe() as it:
        for node, argument in arguments.items():
            it.start(node, '-p', argument)
        setters = {node: Setter(it, node) for node in arguments}
        assert_moving(it)
        # Each set would have to wait for messages otherwise.
        assert setters['plant'].all_or_nothing([('hold_at', 1e-3)]).successful
        Diagnostics(it).until('plant', lambda r: 'is held at' in r.message, 'the hold')
        assert_a_law_brings_its_gains(setters['controller'])
        for name, value, words in (
                ('law', 'picky:law', 'only at the start'),
                ('switching', 'own_switching:Smooth', 'only at the start'),
                # As `ros2 param set` sends what YAML does not take for a number.
                ('kp', '1e-9', "; write 1.0e-9, because YAML reads '1e-9' as text"),
                ('ki', [501.0, 0.0], 'law picky:Law cannot be constructed: ValueError: too much')):
            answer = it.set('controller', name, value)
            assert not answer.successful and words in answer.reason
        for node, setter in setters.items():
            before = setter.values()
            for bad in WRONG[node]:
                valid = [item for item in VALID[node].items() if item[0] != bad[0]]
                for at in (0, len(valid)):
                    answer = setter.all_or_nothing([*valid[:at], bad, *valid[at:]])
                    assert not answer.successful, (node, bad)
                    assert bad[0] in answer.reason or bad[0] == 'use_sim_time'  # That is rclpy's.
                    assert setter.values() == before
            assert not setter.all_or_nothing([]).successful
        assert not (tmp_path / 'imported').exists()
        assert it.set('plant', 'hold_at', 0.0).successful
        assert_moving(it)
        for node, setter in setters.items():
            before = setter.values()
            answer = setter.all_or_nothing(VALID[node].items())
            assert (answer.successful, answer.reason) == (True, '')
            assert setter.values() == {**before, **VALID[node]} != before
        assert it.set('controller', 'law', 'picky:Law').successful
        assert_moving(it)

        assert it.set('plant', 'hold_at', 1e-3).successful
        for node, setter in setters.items():
            for value in ODD:
                results = setter.set(SetParameters, [
                    Parameter(name=name, value=value) for name in (*setter.names, *NO_NAMES)
                    if name not in ('hold_at', 'use_sim_time')]).results
                assert all(result.successful or result.reason for result in results)
                assert not any(result.successful for result in results[-len(NO_NAMES):])
            found = setter.values()
            assert isinstance(found.pop('use_sim_time'), bool)
            assert {name: list(x) if isinstance(x, tuple) else x for name, x in
                    NODES[node].from_mapping(found).as_mapping().items()} == found
        assert {child.status for child in it.children} == {None}
        assert not any('Traceback' in line for line in it.lines)


def test_a_law_at_the_start_takes_its_own_gains_unless_some_are_given() -> None:
    with probe() as it:
        law = ('-p', 'law:=observer_feedback')
        it.start('controller', *law)
        it.start('controller', *law, '-p', 'ka:=[60.0, 30.0]', '-r', '__node:=other')
        assert it.get('controller', 'kp') == [1e4, 1e4]
        assert (it.get('other', 'ka'), it.get('other', 'kp')) == ([60.0, 30.0], [100.0, 100.0])
    assert not any('law None' in line for line in it.lines)
