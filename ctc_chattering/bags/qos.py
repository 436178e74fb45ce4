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

"""Profiles of quality of service as bags store them, in YAML."""

from __future__ import annotations

from typing import Any

import yaml

#: What a policy may be, in the order of its numbers in bags before ROS 2 Jazzy.
_POLICIES = {
    'history': ('system_default', 'keep_last', 'keep_all', 'unknown'),
    'reliability': ('system_default', 'reliable', 'best_effort', 'unknown', 'best_available'),
    'durability': ('system_default', 'transient_local', 'volatile', 'unknown', 'best_available'),
    'liveliness': ('system_default', 'automatic', 'manual_by_node', 'manual_by_topic', 'unknown',
                   'best_available')}

Profiles = tuple[dict[str, Any], ...]


def offered_qos(depth: int, latched: bool) -> str:
    """Return the profile of a reliable publisher as a bag stores it, in YAML."""
    unlimited = {'sec': 9223372036, 'nsec': 854775807}
    return yaml.safe_dump([{
        'history': 'keep_last', 'depth': depth, 'reliability': 'reliable',
        'durability': 'transient_local' if latched else 'volatile', 'deadline': {**unlimited},
        'lifespan': {**unlimited}, 'liveliness': 'automatic',
        'liveliness_lease_duration': unlimited, 'avoid_ros_namespace_conventions': False}])


def profiles(offered: Any) -> Profiles:
    """
    Return profiles with the names of their policies; none if they cannot be read.

    Parameters
    ----------
    offered : str or list
        As a bag has them, in YAML or not.

    """
    try:
        found = (yaml.safe_load(offered) if isinstance(offered, str) else offered) or []
        return tuple({**profile, **{
            key: names[profile[key]] if isinstance(profile[key], int) else profile[key]
            for key, names in _POLICIES.items()}} for profile in found)
    except (yaml.YAMLError, LookupError, TypeError, ValueError):
        return ()


def named_policies(text: str) -> str:
    """Return profiles in YAML, with the names of their policies."""
    found = profiles(text)
    return yaml.safe_dump(list(found)) if found or not text else ''
