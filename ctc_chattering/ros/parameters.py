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
Parameters of a node: declared from its configuration, served, checked and announced.

`BaseNode` serves them by `TolerantParameterService`. Each node has a `NodeParameters` of its
`Config`, whose declarations say all about a parameter, and which checks every value.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
import time
from typing import Any

from ctc_chattering.configuration.topics import PARAMETERS
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.numerics.leaky_bucket import LeakyBucket
from ctc_chattering.parameters import Config, Parameter
from ctc_chattering.ros.messages import stamp
from ctc_chattering.ros.subscription import qos
from rcl_interfaces.msg import (
    ParameterDescriptor,
    ParameterEvent,
    ParameterType,
    SetParametersResult,
)
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.parameter import Parameter as RosParameter
from rclpy.parameter_service import ParameterService

#: Last changes of the parameters that a later subscriber is told.
CHANGES = 1000
#: Share of the time that setting parameters may take. A slider that is moved takes less.
MAX_SET_SHARE = 0.5
#: Time that setting parameters may take at once [s], such as those of a file.
MAX_SET_BURST_S = 1.0

_TOO_MANY = ('too many requests: setting parameters took more than half of the time; ask again '
             'later')


class TolerantParameterService(ParameterService):
    """
    Parameter services that hold up nothing more urgent, whatever is requested.

    Requests for the services in ``node.urgent`` are answered before each request. Requests to set
    parameters are refused where they take too much of the time. A value of an unknown type counts
    as not set, because rclpy would raise in the node's spin.

    Parameters
    ----------
    node : BaseNode
        Owner of the parameters.

    Attributes
    ----------
    names : frozenset of str
        Parameters that the present request sets, together or one after the other.

    """

    def __init__(self, node: Any) -> None:
        earlier = set(node.services)
        super().__init__(node)
        for service in set(node.services) - earlier:
            service.callback = partial(self._serve, node, service.callback)
        self.names: frozenset[str] = frozenset()
        self._set_time = LeakyBucket(MAX_SET_SHARE, MAX_SET_BURST_S)

    def _serve(self, node: Any, callback: Callable[[Any, Any], Any], request: Any, response: Any
               ) -> Any:
        """Answer a request for parameters, after those that are more urgent."""
        for service in node.urgent:
            serve_waiting(service)
        if isinstance(request, (SetParameters.Request, SetParametersAtomically.Request)):
            return self._set(callback, request, response)
        return callback(request, response)

    def _set(self, callback: Callable[[Any, Any], Any], request: Any, response: Any) -> Any:
        """Set parameters, unless that took too much of the time."""
        begin = time.monotonic()
        if self._set_time.fill(0.0, begin):
            if isinstance(response, SetParameters.Response):
                response.results = [_refuse(_TOO_MANY)] * len(request.parameters)
            else:
                response.result = _refuse(_TOO_MANY)
            return response
        self.names = frozenset(parameter.name for parameter in request.parameters)
        for parameter in request.parameters:
            if parameter.value.type > ParameterType.PARAMETER_STRING_ARRAY:
                parameter.value.type = ParameterType.PARAMETER_NOT_SET
        callback(request, response)
        self._set_time.fill(time.monotonic() - begin, begin)
        return response


def serve_waiting(service: Any) -> None:
    """Answer the waiting requests for a service before any others."""
    while True:
        with service.handle:
            request, header = service.handle.service_take_request(service.srv_type.Request)
        if header is None:
            return
        service.send_response(service.callback(request, service.srv_type.Response()), header)


def _refuse(reason: str) -> SetParametersResult:
    """Return the refusal of a set."""
    return SetParametersResult(successful=False, reason=reason)


class NodeParameters:
    """
    Parameters of a node, and the configuration that follows them.

    A set that is not allowed is refused with the reason and changes nothing. Integers are accepted
    for floats.

    Parameters
    ----------
    node : BaseNode
        Declares them. Its `check` refuses a configuration that a set would make, its `completed`
        adds values to a set, and its `on_change` follows a set.
    config_type : Config type
        Declarations of all parameters of the node.

    Attributes
    ----------
    config : Config
        Configuration in force.
    changed : bool
        Whether a change has not been announced yet.

    Raises
    ------
    CtcError
        If one of the node's values is not allowed.

    """

    def __init__(self, node: Any, config_type: type[Config]) -> None:
        self._node = node
        self._declared = config_type.parameters()
        self.config: Any = config_type.from_mapping(self._without_ros(node.given))
        #: Configuration that the present set makes.
        self._candidate = self.config
        #: Values at the start: a class that they name may be named again.
        self._initial = self.config.as_mapping()
        for name, value in self._initial.items():
            node.declare_parameter(
                name, to_parameter(name, value).value, descriptor(self._declared[name]))
        self._publisher = node.create_publisher(
            ParameterEvent, f'~/{PARAMETERS}', qos(CHANGES, latched=True))
        self._announced: dict[str, Any] = {}
        self.changed = True
        node.add_pre_set_parameters_callback(self._complete)
        node.add_on_set_parameters_callback(self._validate)
        node.add_post_set_parameters_callback(self._apply)

    def _without_ros(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the values without those of ROS's own parameters."""
        return {name: value for name, value in values.items() if name in self._declared}

    def assign(self, values: Mapping[str, Any]) -> None:
        """Set parameters by name, as a request of another node would."""
        self._node.set_parameters_atomically([to_parameter(*item) for item in values.items()])

    def announce(self, t: int) -> None:
        """Publish the changes, in force from the state at `t` [ns]."""
        values = self.config.as_mapping()
        messages = [to_parameter(*item).to_parameter_msg()
                    for item in _changes(self._announced, values).items()]
        field = 'changed_parameters' if self._announced else 'new_parameters'
        self._announced = values
        self.changed = False
        if messages:
            self._publisher.publish(ParameterEvent(
                stamp=stamp(t), node=self._node.get_fully_qualified_name(), **{field: messages}))

    def announce_change(self, t: int) -> None:
        """Publish the changes since the last `announce`, if there was one."""
        if self.changed and self._announced:
            self.announce(t)

    def _complete(self, parameters: list[RosParameter]) -> list[RosParameter]:
        """Return typed parameters, with those that the node adds."""
        coerced = [self._coerce(parameter) for parameter in parameters]
        added = self._node.completed({x.name: x.value for x in coerced})
        return coerced + [to_parameter(*item) for item in added.items()]

    def _coerce(self, parameter: RosParameter) -> RosParameter:
        """Return a parameter with its declared type, if it fits."""
        name = parameter.name
        if not self._node.has_parameter(name):  # rclpy takes an empty name.
            raise ParameterNotDeclaredException([name])
        if name in self._declared:
            joints = len(getattr(self.config, 'joint_names', ()))
            with suppress(ParameterError):  # `_validate` refuses it with the reason.
                return to_parameter(name, self._declared[name].coerce(parameter.value, joints))
        return parameter

    def _validate(self, parameters: list[RosParameter]) -> SetParametersResult:
        """Accept a set and keep its configuration, or refuse it."""
        values = {parameter.name: parameter.value for parameter in parameters}
        try:
            for name, value in values.items():
                self._check_while_running(name, value)
            self._candidate = self.config.changed(self._without_ros(values))
            self._node.check(self._candidate)
        except CtcError as error:
            return _refuse(str(error))
        return SetParametersResult(successful=True)

    def _check_while_running(self, name: str, value: Any) -> None:
        """Raise `ParameterError` for a value not allowed in a running node."""
        if name == 'use_sim_time' and value is True and not self._node.count_publishers('/clock'):
            raise ParameterError(name, value, (
                'false, because /clock has no publisher and time would stand still'))
        declared = self._declared.get(name)
        if declared is None:
            return
        if value is None:  # rclpy would undeclare the parameter.
            raise ParameterError(name, None, declared.allowed)
        allowed = list(dict.fromkeys((*declared.choices, self._initial[name])))
        if declared.custom and value not in allowed:
            raise ParameterError(
                name, value, f'{" | ".join(allowed)}; other classes only at the start of the node')

    def _apply(self, _parameters: list[RosParameter]) -> None:
        """Put the candidate in force, and log what it changes."""
        initial = self.config.as_mapping()
        changes = _changes(initial, self._candidate.as_mapping())
        for name, value in changes.items():
            self._node.get_logger().info(f'{name}: {_text(initial[name])} -> {_text(value)}')
        if changes:
            self.config = self._candidate
            self.changed = True
            self._node.on_change()


def _changes(initial: Mapping[str, Any], final: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of `final` that differ from those of `initial`."""
    return {name: value for name, value in final.items() if initial.get(name) != value}


def to_parameter(name: str, value: Any) -> RosParameter:
    """Return a parameter of ROS, where an empty list has no type and becomes ['']."""
    if isinstance(value, tuple):
        value = list(value) or ['']
    return RosParameter(name, value=value)


def _text(value: object) -> str:
    """Return a value as a parameter file has it."""
    return str(list(value) if isinstance(value, tuple) else value)


def descriptor(declared: Parameter) -> ParameterDescriptor:
    """Return the descriptor of a parameter, without ranges, which `Config` checks."""
    unit = f' [{declared.unit}]' if declared.unit else ''
    return ParameterDescriptor(
        name=declared.name,
        description=declared.meaning + unit,
        read_only=declared.read_only,
        additional_constraints=declared.allowed,
        dynamic_typing=True)
