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

"""The bare ping-pong of the benchmark: JointState one way, Float64MultiArray back."""

from __future__ import annotations

from array import array
import os
import sys
import time

from ctc_chattering.ros.spinning import Executor
from ctc_chattering.ros.subscription import qos
import rclpy
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray


def ping(trips: int) -> float:
    """Return round trips per second, over `trips` of them."""
    node = rclpy.create_node('ping')
    executor = Executor()
    executor.add_node(node)
    publisher = node.create_publisher(JointState, 'ping', qos())
    message = JointState(name=['joint1', 'joint2'])
    done, left = Future(), trips
    rows = [array('d', [0.1 * i, 0.2 * i]) for i in range(3)]

    def send() -> None:
        message.position, message.velocity, message.effort = rows
        publisher.publish(message)

    def on_pong(_message: Float64MultiArray) -> None:
        nonlocal left
        left -= 1
        if left > 0:
            send()
        else:
            done.set_result(None)

    node.create_subscription(Float64MultiArray, 'pong', on_pong, qos())
    while not (publisher.get_subscription_count() and node.count_publishers('pong')):
        executor.spin_until_future_complete(done, 0.05)
    time.sleep(0.5)  # The other side may still be discovering us.
    begin = time.perf_counter()
    send()
    while not done.done():
        executor.spin_until_future_complete(done, 0.5)
    return trips / (time.perf_counter() - begin)


def pong() -> None:
    """Answer until killed."""
    node = rclpy.create_node('pong')
    executor = Executor()
    executor.add_node(node)
    publisher = node.create_publisher(Float64MultiArray, 'pong', qos())
    message, row = Float64MultiArray(), array('d', [1.0, 2.0])

    def on_ping(_message: JointState) -> None:
        message.data = row
        publisher.publish(message)

    node.create_subscription(JointState, 'ping', on_ping, qos())
    while True:
        executor.spin_until_future_complete(Future(), 0.5)


if __name__ == '__main__':
    if sys.argv[1]:
        os.sched_setaffinity(0, map(int, sys.argv[1].split(',')))
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    if sys.argv[2] == 'ping':
        print(ping(int(sys.argv[3])))
    else:
        pong()
