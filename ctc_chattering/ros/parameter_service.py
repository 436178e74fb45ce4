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

"""The services that set parameters, for requests that rclpy's own would raise at."""

from __future__ import annotations

from typing import Any

from rcl_interfaces.msg import ParameterType
from rclpy.parameter_service import ParameterService


class TolerantParameterService(ParameterService):
    """Takes a value of no known type for one that is not set; rclpy's raises, in our spin."""

    #: Parameters that the request at hand sets, one after the other or together.
    names: frozenset[str] = frozenset()

    def _set_parameters_callback(self, request: Any, response: Any) -> Any:
        return super()._set_parameters_callback(self._typed(request), response)

    def _set_parameters_atomically_callback(self, request: Any, response: Any) -> Any:
        return super()._set_parameters_atomically_callback(self._typed(request), response)

    def _typed(self, request: Any) -> Any:
        self.names = frozenset(parameter.name for parameter in request.parameters)
        for parameter in request.parameters:
            if parameter.value.type > ParameterType.PARAMETER_STRING_ARRAY:
                parameter.value.type = ParameterType.PARAMETER_NOT_SET
        return request
