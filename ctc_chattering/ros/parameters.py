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

"""ROS parameters from the core's declarations: nothing about a parameter is said twice."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
import time
from typing import Any

from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.parameters import Config, Parameter
from ctc_chattering.ros.messages import stamp
from ctc_chattering.ros.subscription import qos
from ctc_chattering.ros.topics import PARAMETERS
from rcl_interfaces.msg import (
    ParameterDescriptor,
    ParameterEvent,
    ParameterType,
    SetParametersResult,
)
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.parameter import Parameter as RosParameter
from rclpy.parameter_service import ParameterService

#: Last changes of the parameters that who comes later is told, too.
CHANGES = 1000


#: Share of the time that setting parameters may take: a slider that is moved takes less.
_SHARE = 0.5
#: What setting parameters may take at once [s], such as those of a file.
_BURST = 1.0
_TOO_MANY = ('too many requests: setting parameters took more than half of the time; ask again '
             'later')


class TimeBudget:
    """
    Limits the share of the time that something takes, but for bursts.

    Parameters
    ----------
    share : float
        Of the time, in the long run.
    burst : float
        What may be taken beyond it [s].

    """

    def __init__(self, share: float, burst: float) -> None:
        self._share, self._burst = share, burst
        #: What was taken beyond the share, and until when that is known [s].
        self._debt = self._known = 0.0

    def exhausted(self, now: float) -> bool:
        """Return whether too much was taken until `now` [s]."""
        self._debt = max(self._debt - self._share * (now - self._known), 0.0)
        self._known = now
        return self._debt > self._burst

    def spend(self, until: float) -> None:
        """Note that all of the time since the last call was taken, until now [s]."""
        self._debt += (1.0 - self._share) * (until - self._known)
        self._known = until


class TolerantParameterService(ParameterService):
    """
    Serves parameters so that no request, and no number of them, holds up what is more urgent.

    A value of no known type is taken for one that is not set; rclpy's service raises, in our spin.
    Before each request those of ``node.urgent`` are served; requests to set parameters are refused
    where they take too much of the time.

    Parameters
    ----------
    node : BaseNode
        Whose parameters they are.

    Attributes
    ----------
    names : frozenset of str
        Parameters that the request at hand sets, one after the other or together.

    """

    def __init__(self, node: Any) -> None:
        before = set(node.services)
        super().__init__(node)
        for service in set(node.services) - before:
            service.callback = partial(self._serve, node, service.callback)
        self.names: frozenset[str] = frozenset()
        self._budget = TimeBudget(_SHARE, _BURST)

    def _serve(self, node: Any, callback: Callable[[Any, Any], Any], request: Any, response: Any
               ) -> Any:
        """Answer a request for parameters, after what is more urgent."""
        for service in node.urgent:
            serve_waiting(service)
        return callback(request, response)

    def _set_parameters_callback(self, request: Any, response: Any) -> Any:
        if self._budget.exhausted(time.monotonic()):
            response.results = [_refused(_TOO_MANY)] * len(request.parameters)
            return response
        response = super()._set_parameters_callback(self._typed(request), response)
        self._budget.spend(time.monotonic())
        return response

    def _set_parameters_atomically_callback(self, request: Any, response: Any) -> Any:
        if self._budget.exhausted(time.monotonic()):
            response.result = _refused(_TOO_MANY)
            return response
        response = super()._set_parameters_atomically_callback(self._typed(request), response)
        self._budget.spend(time.monotonic())
        return response

    def _typed(self, request: Any) -> Any:
        self.names = frozenset(parameter.name for parameter in request.parameters)
        for parameter in request.parameters:
            if parameter.value.type > ParameterType.PARAMETER_STRING_ARRAY:
                parameter.value.type = ParameterType.PARAMETER_NOT_SET
        return request


def serve_waiting(service: Any) -> None:
    """Answer the requests that wait for a service, before others that came earlier."""
    while True:
        with service.handle:
            request, header = service.handle.service_take_request(service.srv_type.Request)
        if header is None:
            return
        service.send_response(
            service.callback(request, service.srv_type.Response()), header)


def _refused(reason: str) -> SetParametersResult:
    return SetParametersResult(successful=False, reason=reason)


class NodeParameters:
    """
    Declares the parameters of a node and keeps its configuration in step with them.

    A set that is not allowed is refused with the reason and changes nothing; integers are taken
    where numbers are due.

    Parameters
    ----------
    node : BaseNode
        Where they are declared. Its `check` refuses a configuration that a set would make,
        `completed` adds to the values of a set, and `on_change` is called after it.
    kind : Config type
        Of all parameters of the node.

    Attributes
    ----------
    config : Config
        The present one.
    changed : bool
        Whether something has changed that has not been announced yet.

    Raises
    ------
    CtcError
        If one of the node's values is not allowed.

    """

    def __init__(self, node: Any, kind: type[Config]) -> None:
        self._node = node
        self._specs = kind.parameters()
        self.config: Any = kind.from_mapping(self._ours(node.given))
        #: Values at the start: a class that they name may be named again.
        self._first = self.config.as_mapping()
        self._joints = len(getattr(self.config, 'joint_names', ()))
        for name, value in self._first.items():
            node.declare_parameter(name, _to_parameter(name, value).value,
                                   descriptor(self._specs[name]))
        self._publisher = node.create_publisher(
            ParameterEvent, f'~/{PARAMETERS}', qos(CHANGES, latched=True))
        self._announced: dict[str, Any] = {}
        self.changed = True
        node.add_pre_set_parameters_callback(self._coerce)
        node.add_on_set_parameters_callback(self._validate)
        node.add_post_set_parameters_callback(self._apply)

    def _ours(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the values of parameters of ours, not of ROS."""
        return {name: value for name, value in values.items() if name in self._specs}

    def assign(self, values: Mapping[str, Any]) -> None:
        """Set parameters by name, as a request of another node would."""
        self._node.set_parameters_atomically([_to_parameter(*item) for item in values.items()])

    def announce(self, t: int) -> None:
        """Publish on ``~/parameters`` what has changed: in force from the state at `t` [ns]."""
        now = self.config.as_mapping()
        changed = [_to_parameter(name, value).to_parameter_msg()
                   for name, value in now.items() if self._announced.get(name) != value]
        kind = 'changed_parameters' if self._announced else 'new_parameters'
        self._announced = now
        self.changed = False
        if changed:
            self._publisher.publish(ParameterEvent(
                stamp=stamp(t), node=self._node.get_fully_qualified_name(), **{kind: changed}))

    def announce_change(self, t: int) -> None:
        """Publish what has changed since they were announced, if they were: see `announce`."""
        if self.changed and self._announced:
            self.announce(t)

    def _coerce(self, parameters: list[RosParameter]) -> list[RosParameter]:
        """Turn integers into numbers where such are due, and complete."""
        found = [self._coerced(parameter) for parameter in parameters]
        more = self._node.completed({parameter.name: parameter.value for parameter in found})
        return found + [_to_parameter(name, value) for name, value in more.items()]

    def _coerced(self, parameter: RosParameter) -> RosParameter:
        if not self._node.has_parameter(parameter.name):  # rclpy takes an empty name.
            raise ParameterNotDeclaredException([parameter.name])
        spec = self._specs.get(parameter.name)
        if spec is not None:
            with suppress(ParameterError):  # `_validate` refuses it, and says why.
                value = spec.coerce(parameter.value, self._joints)
                return _to_parameter(spec.name, value)
        return parameter

    def _candidate(self, parameters: Sequence[RosParameter]) -> Any:
        return self.config.changed(self._ours({x.name: x.value for x in parameters}))

    def _validate(self, parameters: list[RosParameter]) -> SetParametersResult:
        try:
            for parameter in parameters:  # One that is not set would be undeclared.
                spec = self._specs.get(parameter.name)
                if spec is not None and parameter.value is None:
                    raise ParameterError(spec.name, None, spec.allowed)
                if spec is not None and spec.custom and parameter.value not in (
                        known := (*spec.choices, self._first[spec.name])):
                    raise ParameterError(spec.name, parameter.value, ' | '.join(
                        dict.fromkeys(known)) + '; others only at the start of the node')
                if (parameter.name == 'use_sim_time' and parameter.value is True
                        and not self._node.count_publishers('/clock')):
                    raise ParameterError('use_sim_time', True, (
                        'false: /clock has no publisher, and time would stand still'))
            self._node.check(self._candidate(parameters))
        except CtcError as error:
            return _refused(str(error))
        return SetParametersResult(successful=True)

    def _apply(self, parameters: list[RosParameter]) -> None:
        new, was = self._candidate(parameters), self.config.as_mapping()
        if new != self.config:
            for name, value in new.as_mapping().items():
                if value != was[name]:
                    self._node.get_logger().info(
                        f'{name}: {_shown(was[name])} -> {_shown(value)}')
            self.config = new
            self.changed = True
            self._node.on_change()


def _to_parameter(name: str, value: Any) -> RosParameter:
    """Return a parameter of ROS: an empty list has no type there, and becomes a list of ''."""
    return RosParameter(name, value=list(value) or [''] if isinstance(value, tuple) else value)


def _shown(value: object) -> str:
    return str(list(value) if isinstance(value, tuple) else value)


def descriptor(spec: Parameter) -> ParameterDescriptor:
    """Return the descriptor of a parameter; `Parameter` checks values, for a better message."""
    unit = f' [{spec.unit}]' if spec.unit else ''
    return ParameterDescriptor(
        name=spec.name, description=spec.meaning + unit, read_only=spec.read_only,
        additional_constraints=spec.allowed, dynamic_typing=True)
