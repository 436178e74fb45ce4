"""ROS parameters from the core's declarations: nothing about a parameter is said twice."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterEvent,
    SetParametersResult,
)
from rclpy.exceptions import ParameterException, ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.parameters import Config, Parameter
from ctc_chattering.ros.messages import stamp
from ctc_chattering.ros.node import qos
from ctc_chattering.ros.topics import PARAMETERS

C = TypeVar('C', bound=Config)

_ROS_TYPES = {
    'bool': RosParameter.Type.BOOL, 'int': RosParameter.Type.INTEGER,
    'float': RosParameter.Type.DOUBLE, 'str': RosParameter.Type.STRING,
    'float[]': RosParameter.Type.DOUBLE_ARRAY, 'str[]': RosParameter.Type.STRING_ARRAY}


class NodeParameters:
    """
    Declares the parameters of a node and keeps its configurations in step with them.

    A set that is not allowed is refused with the reason and changes nothing; integers are taken
    where numbers are due.

    Parameters
    ----------
    node : Node
        Where they are declared.
    configs : sequence of Config types
        Together they hold all parameters of the node.
    changed : callable
        Called after every accepted set.
    check : callable, optional
        Called with the configurations that a set would make; refuses it by `CtcError`.

    Attributes
    ----------
    changed : bool
        Whether something has changed that has not been announced yet.

    Raises
    ------
    CtcError
        If an override is not allowed.

    """

    def __init__(self, node: Node, configs: Sequence[type[Config]],
                 changed: Callable[[], None],
                 check: Callable[[Sequence[Config]], None] = lambda _: None) -> None:
        self._node = node
        self._changed, self._check = changed, check
        self._specs = {
            name: spec for config in configs for name, spec in config.parameters().items()}
        values = {}
        for name in self._specs:
            value = _override(node, name)
            if value is not None:
                values[name] = value
        self._configs = [config.from_mapping(
            {name: value for name, value in values.items() if name in config.parameters()})
            for config in configs]
        for config in self._configs:
            for name, value in config.as_mapping().items():
                node.declare_parameter(name, _to_ros(value), descriptor(self._specs[name]),
                                       ignore_override=True)
        self._publisher = node.create_publisher(
            ParameterEvent, f'~/{PARAMETERS}', qos(100, latched=True))
        self._announced: dict[str, Any] = {}
        self.changed = True
        node.add_pre_set_parameters_callback(self._coerce)
        node.add_on_set_parameters_callback(self._validate)
        node.add_post_set_parameters_callback(self._apply)

    def get(self, kind: type[C]) -> C:
        """Return the present configuration of type `kind`."""
        for config in self._configs:
            if isinstance(config, kind):
                return config
        raise TypeError(kind)

    def announce(self, t: int) -> None:
        """Publish on ``~/parameters`` what has changed: in force from the state at `t` [ns]."""
        now = {name: value for config in self._configs
               for name, value in config.as_mapping().items()}
        message = ParameterEvent(stamp=stamp(t), node=self._node.get_fully_qualified_name())
        changed = [self._to_parameter(name, value).to_parameter_msg()
                   for name, value in now.items() if self._announced.get(name) != value]
        if self._announced:
            message.changed_parameters = changed
        else:
            message.new_parameters = changed
        self._announced = now
        self.changed = False
        if changed:
            self._publisher.publish(message)

    def _to_parameter(self, name: str, value: Any) -> RosParameter:
        return RosParameter(name, _ROS_TYPES[self._specs[name].kind], _to_ros(value))

    def _coerce(self, parameters: list[RosParameter]) -> list[RosParameter]:
        """Turn integers and words for numbers into numbers where such are due."""
        result = []
        for parameter in parameters:
            if not self._node.has_parameter(parameter.name):  # rclpy takes an empty name.
                raise ParameterNotDeclaredException([parameter.name])
            spec = self._specs.get(parameter.name)
            try:
                coerced = parameter if spec is None else self._to_parameter(
                    parameter.name, spec.coerce(_numbers(spec, parameter.value)))
            except ParameterError:
                coerced = parameter
            result.append(coerced)
        return result

    def _candidates(self, parameters: Sequence[RosParameter]) -> list[Config]:
        values = {p.name: p.value for p in parameters if p.name in self._specs}
        return [config.changed({
            name: value for name, value in values.items() if name in config.parameters()})
            for config in self._configs]

    def _validate(self, parameters: list[RosParameter]) -> SetParametersResult:
        try:
            for parameter in parameters:  # One that is not set would be undeclared.
                spec = self._specs.get(parameter.name)
                if spec is not None and parameter.value is None:
                    raise ParameterError(spec.name, None, spec.allowed)
                if (parameter.name == 'use_sim_time' and parameter.value is True
                        and not self._node.count_publishers('/clock')):
                    raise ParameterError('use_sim_time', True, (
                        'false: /clock has no publisher, and time would stand still'))
            self._check(self._candidates(parameters))
        except CtcError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply(self, parameters: list[RosParameter]) -> None:
        new = self._candidates(parameters)
        if new != self._configs:
            self._configs = new
            self.changed = True
            self._changed()


def _override(node: Node, name: str) -> Any:
    """Return the value that the command line or a file gives, of whatever type; None without."""
    try:
        value = node.declare_parameter(
            name, descriptor=ParameterDescriptor(dynamic_typing=True)).value
        node.undeclare_parameter(name)
    except ParameterException as error:
        raise CtcError(' '.join(str(error).split())) from None
    return value


def _numbers(spec: Parameter, value: Any) -> Any:
    """
    Return `value` with words for numbers replaced, where `spec` wants numbers.

    `ros2 param load` and `set` print ``.inf`` as ``inf``, which is a string in YAML, as ``1e-05``
    is, and send a list of numbers and strings as one string.
    """
    if spec.kind not in ('float', 'float[]'):
        return value
    items = value
    if isinstance(value, str):
        text = value.strip()
        if not (text.startswith('[') and text.endswith(']')):
            return _number(text)
        items = text[1:-1].split(',')
    if not isinstance(items, list):
        return value
    numbers = [_number(x.strip()) if isinstance(x, str) else x for x in items]
    return value if any(isinstance(x, str) for x in numbers) else numbers


def _number(text: str) -> float | str:
    try:
        return float(text.replace('.inf', 'inf'))
    except ValueError:
        return text


def _to_ros(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def descriptor(spec: Parameter) -> ParameterDescriptor:
    """Return the descriptor of a parameter; its type is judged by us, for a better message."""
    unit = f' [{spec.unit}]' if spec.unit else ''
    result = ParameterDescriptor(
        name=spec.name, type=_ROS_TYPES[spec.kind].value, description=spec.meaning + unit,
        additional_constraints=spec.allowed, read_only=spec.read_only, dynamic_typing=True)
    low, high = spec.bounds
    if spec.kind in ('float', 'float[]') and not spec.infinite and spec.shape != 'nn':
        result.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    elif spec.kind == 'int':
        result.integer_range = [IntegerRange(
            from_value=int(low), to_value=int(high), step=1)]
    return result
