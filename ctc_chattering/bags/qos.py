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

from rosbags.interfaces import (
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
)
import yaml

#: Policies that recorders before Jazzy write as numbers.
_POLICIES = {'history': QosHistory, 'reliability': QosReliability, 'durability': QosDurability,
             'liveliness': QosLiveliness}


def offered_qos(depth: int, latched: bool) -> str:
    """Return the profile of a reliable publisher as a bag stores it, in YAML."""
    unlimited = {'sec': 9223372036, 'nsec': 854775807}
    return yaml.safe_dump([{
        'history': 'keep_last', 'depth': depth, 'reliability': 'reliable',
        'durability': 'transient_local' if latched else 'volatile', 'deadline': {**unlimited},
        'lifespan': {**unlimited}, 'liveliness': 'automatic',
        'liveliness_lease_duration': unlimited, 'avoid_ros_namespace_conventions': False}])


def named_policies(text: str) -> str:
    """Return profiles with the names of their policies; nothing if they cannot be read."""
    try:
        profiles = yaml.safe_load(text) or []
        for profile in profiles:
            for key, kind in _POLICIES.items():
                if isinstance(profile[key], int):
                    profile[key] = kind(profile[key]).name.lower()
    except (yaml.YAMLError, LookupError, TypeError, ValueError):
        return ''
    return yaml.safe_dump(profiles)
