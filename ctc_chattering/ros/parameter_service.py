"""The services that set parameters, for requests that rclpy's own would raise at."""

from __future__ import annotations

from typing import Any

from rcl_interfaces.msg import ParameterType
from rclpy.parameter_service import ParameterService


class TolerantParameterService(ParameterService):
    """Takes a value of no known type for one that is not set; rclpy's raises, in our spin."""

    def _set_parameters_callback(self, request: Any, response: Any) -> Any:
        return super()._set_parameters_callback(_typed(request), response)

    def _set_parameters_atomically_callback(self, request: Any, response: Any) -> Any:
        return super()._set_parameters_atomically_callback(_typed(request), response)


def _typed(request: Any) -> Any:
    for parameter in request.parameters:
        if parameter.value.type > ParameterType.PARAMETER_STRING_ARRAY:
            parameter.value.type = ParameterType.PARAMETER_NOT_SET
    return request
