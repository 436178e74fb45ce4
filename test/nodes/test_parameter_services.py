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

"""Parameters set while the loop runs: all or nothing, and nothing that is sent ends a node."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
import math
from pathlib import Path
import random
from typing import Any, NamedTuple

from ctc_chattering.configuration.node_parameters import NODES
from ctc_chattering.parameters import LARGEST, LEAST, matrix
from ctc_chattering.ros.topics import COMMANDS, JOINT_STATES
from faults import Diagnostics, JOINTS
import numpy as np
from processes import interrupt, Probe, probe
import pytest
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue, SetParametersResult
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter as RosParameter
from rclpy.parameter import parameter_value_to_python
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

pytestmark = pytest.mark.ros
EXAMPLES = Path(__file__).resolve().parents[2] / 'examples'
#: Calls of the fuzzer by node; each sets up to six parameters.
CALLS = {'plant': 150, 'controller': 200, 'reference': 40, 'recorder': 40}
NAN, INF, HUGE, TINY = math.nan, math.inf, 1e308, 5e-324
#: A set of several parameters that is allowed, by node.
VALID: dict[str, dict[str, Any]] = {
    'plant': {'coulomb_friction': [1.0, 2.0], 'command_timeout': 0.5, 'fault_damping': [3.0, 4.0],
              'use_sim_time': True},
    'controller': {'kp': [90.0, 80.0], 'law': 'compensation', 'lambda': 7.0,
                   'anti_windup': False, 'state_decimation': 20, 'use_sim_time': True},
    'reference': {'use_sim_time': True}, 'recorder': {'use_sim_time': True}}
#: What is not, each for another reason; None is for a value that is not set.
WRONG: dict[str, list[tuple[str, Any]]] = {
    'plant': [('viscous_friction', [NAN, 0.0]), ('hold_at', -1.0), ('gravity', 1.0),
              ('command_timeout', 0.0), ('stribeck_velocity', [0.1] * 3), ('', 1.0),
              ('fault_damping', 'much'), ('coulomb_friction', None)],
    'controller': [('kv', [1.0, 2.0, 3.0, 1.0]), ('switching', 'magic'), ('b', INF),
                   ('state_decimation', 0), ('model', 'two_link'), ('ka', [-1.0, 1.0]),
                   ('kp', None), ('unknown', 1), ('law', 'trap:Law'), ('law', 'os:system'),
                   ('switching', 'trap:Law'), ('kp', [100.0, 1.1e7]), ('lambda', 0.09)],
    'reference': [('amplitude', [NAN, 0.0]), ('horizon', 1.0), ('use_sim_time', 'yes')],
    'recorder': [('bag', 'other'), ('unknown', True), ('use_sim_time', None)]}


class Answer(NamedTuple):
    """What a node says to a set."""

    successful: bool
    reason: str


class Setter:
    """The parameter services of a node, one call at a time."""

    def __init__(self, it: Probe, node: str) -> None:
        self.probe, self.node = it, node
        self._clients = {
            kind: it.node.create_client(kind, f'/{node}/{name}') for kind, name in (
                (SetParameters, 'set_parameters'),
                (SetParametersAtomically, 'set_parameters_atomically'),
                (GetParameters, 'get_parameters'))}
        self.names = [*NODES[node].parameters(), 'use_sim_time']
        self.settable = ['use_sim_time', *(
            name for name, spec in NODES[node].parameters().items() if not spec.read_only)]

    def ready(self) -> bool:
        return all(client.service_is_ready() for client in self._clients.values())

    def send(self, kind: Any, parameters: Sequence[Parameter]) -> Any:
        return self._clients[kind].call_async(kind.Request(parameters=parameters))

    def all_or_nothing(self, values: Iterable[tuple[str, Any]]) -> Answer:
        """Call set_parameters_atomically."""
        future = self.send(SetParametersAtomically, [message(*item) for item in values])
        self.probe.until(future.done, f'an answer of {self.node}')
        return Answer(future.result().result.successful, future.result().result.reason)

    def values(self) -> dict[str, Any]:
        """Return all parameters; each must be there."""
        future = self._clients[GetParameters].call_async(
            GetParameters.Request(names=self.names))
        self.probe.until(future.done, f'the values of {self.node}')
        found = [plain(value) for value in future.result().values]
        return dict(zip(self.names, found, strict=True))


def message(name: str, value: Any) -> Parameter:
    if value is None:
        return Parameter(name=name)
    return RosParameter(name, value=value).to_parameter_msg()


def plain(value: ParameterValue) -> Any:
    found = parameter_value_to_python(value)
    return found if isinstance(found, str) or not hasattr(found, '__len__') else list(found)


class Loop:
    """The whole graph in lockstep, and what is needed to see that it goes on."""

    def __init__(self, it: Probe, bag: Path, *plant: str, controller: Sequence[str] = ()) -> None:
        self.probe = it
        self.children = {
            'plant': it.start('plant', '-p', 'pacing:=lockstep', *plant),
            'controller': it.start('controller', *controller), 'reference': it.start('reference'),
            'recorder': it.start('recorder', '-p', f'bag:={bag}')}
        self.setters = {node: Setter(it, node) for node in self.children}
        it.until(lambda: all(x.ready() for x in self.setters.values()), 'the services')
        self.goes_on()

    def goes_on(self) -> None:
        """Wait for torques and the states that answer them; no node may have ended or raised."""
        it = self.probe
        stamps: set[tuple[int, int]] = set()
        torques: list[Float64MultiArray] = []

        def on_state(state: JointState) -> None:
            stamps.add((state.header.stamp.sec, state.header.stamp.nanosec))

        # Not for longer than needed: hearing thousands of messages a second, we would be slow.
        ears = [it.node.create_subscription(JointState, JOINT_STATES, on_state, 10),
                it.node.create_subscription(Float64MultiArray, COMMANDS, torques.append, 10)]

        def moving() -> bool:
            assert [x for x in self.children if self.children[x].status is not None] == []
            return len(torques) > 100 and len(stamps) > 100

        it.until(moving, 'motion')
        for ear in ears:
            it.node.destroy_subscription(ear)
        assert not any('Traceback' in line for line in it.lines)

    def hold(self) -> None:
        """Have simulated time stand still."""
        assert self.setters['plant'].all_or_nothing([('hold_at', 1e-3)]).successful
        Diagnostics(self.probe).until('plant', lambda r: r.message.startswith('held'), 'the hold')


def assert_a_law_brings_its_gains(setter: Setter) -> None:
    """Check that a law that is set without gains takes its own; with them, in any order, those."""
    before = setter.values()
    assert setter.all_or_nothing([('law', 'observer_feedback')]).successful
    assert setter.values()['kp'] == [1e4, 1e4]
    assert not setter.all_or_nothing([('law', 'magic')]).successful
    assert setter.all_or_nothing([('law', 'chattering')]).successful
    assert setter.values() == before
    for node in (SetParameters, SetParametersAtomically):
        future = setter.send(node, [
            message('ka', [60.0, 30.0]), message('law', 'observer_feedback')])
        setter.probe.until(future.done, f'an answer of {setter.node}')
        assert setter.values() == {**before, 'ka': [60.0, 30.0], 'law': 'observer_feedback'}
    assert setter.all_or_nothing([('law', 'chattering')]).successful
    assert setter.values() == before


def test_a_set_is_all_or_nothing_and_a_wrong_one_leaves_the_loop_as_it_was(
        tmp_path: Path) -> None:
    with probe() as it:
        loop = Loop(it, tmp_path / 'bag')
        loop.hold()  # Each set would have to wait for messages otherwise.
        assert_a_law_brings_its_gains(loop.setters['controller'])
        for node, setter in loop.setters.items():
            before = setter.values()
            for bad in WRONG[node]:
                valid = [item for item in VALID[node].items() if item[0] != bad[0]]
                for at in (0, len(valid)):
                    answer = setter.all_or_nothing([*valid[:at], bad, *valid[at:]])
                    assert not answer.successful, (node, bad)
                    assert bad[0] in answer.reason or bad[0] == 'use_sim_time'  # That is rclpy's.
                    assert setter.values() == before
            assert not setter.all_or_nothing([]).successful
        assert it.set('plant', 'hold_at', 0.0).successful
        loop.goes_on()
        for node, setter in loop.setters.items():
            before = setter.values()
            assert setter.all_or_nothing(VALID[node].items()) == (True, '')
            assert setter.values() == {**before, **VALID[node]} != before
        loop.goes_on()


def test_a_law_that_a_node_starts_with_takes_its_own_gains_unless_it_is_given_some() -> None:
    with probe() as it:
        child = it.start('controller', '-p', 'law:=observer_feedback')
        it.until(lambda: any('ka: ' in line and '->' in line for line in it.lines), 'the gains')
        assert it.get('controller', 'kp') == [1e4, 1e4]
        interrupt(child)
        it.lines.clear()
        it.start('controller', '-p', 'law:=observer_feedback', '-p', 'ka:=[60.0, 30.0]')
        it.until(lambda: any('waits for' in line for line in it.lines), 'the node')
        assert (it.get('controller', 'ka'), it.get('controller', 'kp')) == (
            [60.0, 30.0], [100.0, 100.0])


#: A law that cannot be made with every gain, and a module that says that it was imported.
OWN = """
from typing import NamedTuple
from ctc_chattering import law
from own_law import LeakyIntegral
@law()
class Law(NamedTuple):
    own: LeakyIntegral
    @classmethod
    def made(cls, config, period):
        if config.ki[0] > 500.0:
            raise ValueError('too much')
        return cls(LeakyIntegral.made(config, period))
    def initial(self):
        return self.own.initial()
    def terms(self, memory, at):
        return self.own.terms(memory, at)
"""
TRAP = "from pathlib import Path; Path(__file__).with_name('imported').touch()"


def test_a_law_is_named_at_the_start_and_made_before_it_is_set(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is refused leaves the motion as it was, and imports nothing."""
    (tmp_path / 'picky.py').write_text(OWN)
    (tmp_path / 'trap.py').write_text(TRAP)
    monkeypatch.setenv('PYTHONPATH', f'{tmp_path}:{EXAMPLES}')
    monkeypatch.chdir(tmp_path)
    with probe() as it:
        loop = Loop(it, tmp_path / 'bag', controller=('-p', 'law:=picky:Law'))
        for name, value, words in (
                ('law', 'trap:Law', 'only at the start'),
                ('law', 'picky:law', 'only at the start'),
                ('switching', 'own_switching:Smooth', 'only at the start'),
                ('ki', [501.0, 0.0], 'the law picky:Law cannot be made: ValueError: too much')):
            answer = it.set('controller', name, value)
            assert not answer.successful and words in answer.reason
        loop.goes_on()
        for law in ('compensation', 'picky:Law'):
            assert it.set('controller', 'law', law) == SetParametersResult(successful=True)
            loop.goes_on()
            assert it.get('controller', 'law') == law
    assert not (tmp_path / 'imported').exists()


#: What more than is accepted of the random sets: they and the answers are the same each time, 20,
#: 38 and 8, or more, with the limits that parameters have now.
ACCEPTED = {'plant': 15, 'controller': 33, 'reference': 5}
NUMBERS = (0.0, 0.5, 1.0, 2.0, 20.0, -1.0, NAN, INF, -INF, HUGE, -HUGE, TINY, LEAST, LARGEST)
#: What may be drawn of these while the loop runs, as others stop it in good order or have the
#: robot move beyond all numbers.
TAME: dict[str, Sequence[float]] = {
    'hold_at': (0.0, HUGE, -1.0, NAN, INF), 'error_limit': (INF, HUGE, 0.0, -1.0, NAN),
    **dict.fromkeys((
        'coulomb_friction', 'viscous_friction', 'stribeck_friction', 'fault_damping',
        'disturbance.amplitude', 'disturbance.frequency', 'disturbance.push'),
        (0.0, 0.5, 1.0, 20.0, -1.0, NAN, INF, -INF, -0.0, TINY))}
STRINGS = ('', 'law', 'sign', 'chattering', 'compensation', 'boundary_layer', 'implicit',
           'implicit_observer', '1.0', '\0', '\u00fc' * 300, 'x' * 10_000)
LENGTHS = (0, 1, 2, 2, 2, 3, 4, 5, 3000)


def any_value(dice: random.Random, numbers: Sequence[float]) -> ParameterValue:
    """Return a value of any type, of none, or of one that does not exist."""
    def several(pick: Callable[[], Any]) -> list[Any]:
        return [pick() for _ in range(dice.choice(LENGTHS))]

    def number() -> float:
        return dice.choice(numbers)

    def integer() -> int:
        return dice.choice((0, 1, -1, 7, 10 ** 6, 10 ** 6 + 1, 2 ** 63 - 1, -2 ** 63))

    fields: dict[int, tuple[str, Callable[[], Any]]] = {
        ParameterType.PARAMETER_BOOL: ('bool_value', lambda: dice.random() < 0.5),
        ParameterType.PARAMETER_INTEGER: ('integer_value', integer),
        ParameterType.PARAMETER_DOUBLE: ('double_value', number),
        ParameterType.PARAMETER_STRING: ('string_value', lambda: dice.choice(STRINGS)),
        ParameterType.PARAMETER_BYTE_ARRAY: (
            'byte_array_value', lambda: several(lambda: bytes([dice.randrange(256)]))),
        ParameterType.PARAMETER_BOOL_ARRAY: (
            'bool_array_value', lambda: several(lambda: dice.random() < 0.5)),
        ParameterType.PARAMETER_INTEGER_ARRAY: (
            'integer_array_value', lambda: several(integer)),
        ParameterType.PARAMETER_DOUBLE_ARRAY: ('double_array_value', lambda: several(number)),
        ParameterType.PARAMETER_STRING_ARRAY: (
            'string_array_value', lambda: several(lambda: dice.choice(STRINGS)))}
    value = ParameterValue(type=dice.choice((*range(10), *range(10), 10, 77, 255)))
    if value.type in fields:
        field, make = fields[value.type]
        setattr(value, field, make())
    return value


def likely_value(dice: random.Random, kind: str, numbers: Sequence[float]) -> ParameterValue:
    """Return a value of the right type, and often of the right length."""
    if kind == 'float[]':
        return ParameterValue(type=ParameterType.PARAMETER_DOUBLE_ARRAY, double_array_value=[
            abs(dice.choice(numbers)) for _ in range(dice.choice((2, 2, 2, 4)))])
    if kind == 'str':
        return ParameterValue(type=ParameterType.PARAMETER_STRING,
                              string_value=dice.choice(STRINGS))
    value: Any = {'bool': dice.random() < 0.5, 'int': dice.randrange(30)}.get(
        kind, dice.choice(numbers))
    return RosParameter('', value=value).get_parameter_value()


def draw(dice: random.Random, node: str, names: Sequence[str],
         tame: Mapping[str, Sequence[float]]) -> Parameter:
    """Return a parameter to set, which may not exist."""
    name = dice.choice(names) if dice.random() < 0.9 else dice.choice(
        ('', 'x', 'kp.x', ' kp', 'KP', '\u03bb', 'bag' * 100, 'qos_overrides./x'))
    spec = NODES[node].parameters().get(name)
    numbers = tame.get(name, NUMBERS)
    if dice.random() < 0.5:
        kind = 'bool' if spec is None else spec.kind
        return Parameter(name=name, value=likely_value(dice, kind, numbers))
    return Parameter(name=name, value=any_value(dice, numbers))


class Fuzzer:
    """Random sets at a node, and what its parameters must be by the answers."""

    def __init__(self, setter: Setter, calls: int, tame: Mapping[str, Sequence[float]],
                 but: str = '') -> None:
        self.setter, self._left = setter, calls
        self.expected = setter.values()
        self._names = [x for x in (*setter.settable, *setter.settable, *setter.names) if x != but]
        self._tame = tame
        self._dice = random.Random(f'{setter.node} {calls}')
        self._sent: list[Parameter] = []
        self._future: Any = None
        self.accepted = self.refused = 0

    def over(self) -> bool:
        """Judge the answer if it is there, and send the next set; return whether none is left."""
        if self._future is not None:
            if not self._future.done():
                return False
            self._check(self._future.result())
            self._future = None
        if not self._left:
            return True
        self._left -= 1
        self._sent = [draw(self._dice, self.setter.node, self._names, self._tame)
                      for _ in range(self._dice.choice((1, 1, 2, 3, 6)))]
        kind = self._dice.choice((SetParameters, SetParametersAtomically))
        self._future = self.setter.send(kind, self._sent)
        return False

    def _check(self, answer: Any) -> None:
        results = (answer.results if hasattr(answer, 'results')
                   else [answer.result] * len(self._sent))
        for parameter, result in zip(self._sent, results, strict=True):
            if result.successful:
                self.accepted += 1
                value, before = plain(parameter.value), self.expected[parameter.name]
                if isinstance(before, list):  # One number is for all joints.
                    values = value if isinstance(value, list) else [value]
                    value = values * len(JOINTS) if len(values) == 1 else values
                self.expected[parameter.name] = value
            else:
                self.refused += 1
                assert result.reason

    def check(self) -> None:
        """Compare all values with the answers, and with what the declarations allow."""
        found = self.setter.values()
        assert found == self.expected
        assert isinstance(found.pop('use_sim_time'), bool)
        assert {name: list(value) if isinstance(value, tuple) else value for name, value in
                NODES[self.setter.node].from_mapping(found).as_mapping().items()} == found


def reach(setter: Setter, name: str, before: Any, after: Any) -> None:
    """Set a parameter; where that is too much at once, their geometric mean before."""
    done, reason = setter.all_or_nothing([(name, after)])
    if not done:
        assert 'a factor of at most 100 at once' in reason
        spec, n = NODES['controller'].parameters()[name], len(JOINTS)
        old, new = (matrix(x, n).diagonal() if spec.shape == 'nn' else np.array(x)
                    for x in (before, after))
        mean = np.where((old > 0.0) & np.isfinite(old), np.sqrt(old) * np.sqrt(new), new).tolist()
        reach(setter, name, before, mean)
        reach(setter, name, mean, after)


@pytest.mark.slow
def test_a_thousand_random_sets_end_no_node_and_leave_valid_values(tmp_path: Path) -> None:
    """The loop runs meanwhile, with whatever gains; its drives are limited, as real ones are."""
    with probe() as it:
        loop = Loop(it, tmp_path / 'bag', '-p', 'torque_saturation:=[30.0, 30.0]')
        initial = {node: setter.values() for node, setter in loop.setters.items()}
        fuzzers = [Fuzzer(setter, CALLS[node], TAME)
                   for node, setter in loop.setters.items() if node != 'recorder']
        it.until(lambda: False not in [x.over() for x in fuzzers], 'the answers')
        for fuzzer in fuzzers:
            fuzzer.check()
            assert fuzzer.refused > 50
            assert fuzzer.accepted > ACCEPTED[fuzzer.setter.node]
        assert sum(x.refused + x.accepted for x in fuzzers) > 900
        setter, before = loop.setters['controller'], loop.setters['controller'].values()
        for name in setter.settable[1:]:  # Without use_sim_time.
            reach(setter, name, before[name], initial['controller'][name])
        for node, setter in loop.setters.items():
            assert setter.all_or_nothing(
                [(name, initial[node][name]) for name in setter.settable]) == (True, '')
            assert setter.values() == initial[node]
        assert it.call(Trigger, '/controller/reset', Trigger.Request()).success
        loop.goes_on()

        # Any friction and disturbance while time is held, after which they are as before; and the
        # recorder, whose services have to wait for messages otherwise.
        plant = loop.setters['plant']
        loop.hold()
        fuzzers = [Fuzzer(plant, 100, {}, but='hold_at'),
                   Fuzzer(loop.setters['recorder'], CALLS['recorder'], TAME)]
        it.until(lambda: False not in [x.over() for x in fuzzers], 'the answers')
        for fuzzer in fuzzers:
            fuzzer.check()
        assert fuzzers[0].accepted > 10 and fuzzers[1].refused > 50
        assert plant.all_or_nothing(
            [(name, initial['plant'][name]) for name in plant.settable]).successful
        loop.goes_on()
