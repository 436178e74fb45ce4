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

"""The paper's loop in real time, and what its nodes say of themselves, for benchmarks."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
import os
import random

from ctc_chattering.configuration.node_parameters import LOOP
from ctc_chattering.configuration.package_share import config_directory
from ctc_chattering.configuration.topics import DIAGNOSTICS
from ctc_chattering.launch import child_process
from ctc_chattering.ros.process import use_profile
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import rclpy

Reports = dict[str, list[DiagnosticStatus]]


@contextmanager
def real_time_loop(*ros_args: str) -> Iterator[tuple[Reports, Callable[[], None]]]:
    """
    Run plant, controller and reference in a domain of their own.

    Yields the reports on ``/diagnostics`` by node, and a function that takes what has come; it
    raises an error if a node has ended.
    """
    reports: Reports = defaultdict(list)

    def on_message(message: DiagnosticArray) -> None:
        for status in message.status:
            reports[status.name].append(status)

    os.environ.update(ROS_DOMAIN_ID=str(random.randint(1, 101)),
                      ROS_AUTOMATIC_DISCOVERY_RANGE='LOCALHOST')
    use_profile()
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node('benchmark', context=context)
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    executor.add_node(node)
    node.create_subscription(DiagnosticArray, DIAGNOSTICS, on_message, 10)
    children = [child_process.Child(name, child_process.node_command(
        name, '--ros-args', '--params-file', str(config_directory() / 'friction.yaml'), *ros_args,
        *(('-p', 'pacing:=real_time', '-p', 'duration:=0.0') if name == 'plant' else ())),
        lambda _: None) for name in LOOP]

    def spin() -> None:
        executor.spin_once(0.1)
        ended = [child.exit_report() for child in children if child.status is not None]
        assert not ended, ended

    try:
        yield reports, spin
    finally:
        child_process.stop(children)
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown(context=context)
