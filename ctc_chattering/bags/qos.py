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
